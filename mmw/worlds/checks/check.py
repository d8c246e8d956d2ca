"""Check a stage by every rule."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mmw.core.resources import town_path
from mmw.usd.open_stage import reads_usd
from mmw.usd.validate import find_problems
from mmw.worlds.checks.closed_meshes import solid_findings
from mmw.worlds.checks.components import find_components
from mmw.worlds.checks.coplanar_faces import coplanar_findings
from mmw.worlds.checks.findings import SEVERITIES, Finding, Severity
from mmw.worlds.checks.lane_graph import lane_findings
from mmw.worlds.checks.missing_materials import material_findings
from mmw.worlds.checks.road import road_findings
from mmw.worlds.checks.scale import size_findings
from mmw.worlds.checks.stage_model import StageModel, open_stage_model
from mmw.worlds.checks.support import support_findings

_SEVERITY: dict[str, Severity] = {"error": "error", "warn": "warning", "info": "info"}


@dataclass(frozen=True)
class Report:
    """Findings of a check."""

    path: Path
    findings: tuple[Finding, ...]
    """Errors first, then warnings, then information; by rule and prim within."""

    def count(self, severity: Severity) -> int:
        """Return the number of findings of a severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def summary(self) -> str:
        """One line for people."""
        rules = Counter(finding.rule for finding in self.findings if finding.severity != "info")
        listed = f" ({', '.join(f'{rule} {count}' for rule, count in rules.items())})" if rules else ""
        return f"{self.path}: {self.count('error')} errors, {self.count('warning')} warnings{listed}"


def stage_path(name: str) -> Path:
    """Return the USD file that a command names: a path, or the name of a shipped town.

    Raises:
        InputError: If no shipped town has the name.
    """
    return Path(name) if Path(name).suffix else town_path(name)


@reads_usd
def check_stage(path: Path, material_map: Mapping[str, str] | None = None) -> Report:
    """Check a town, or any other stage.

    Args:
        path: USD file.
        material_map: Glob of mesh prim paths -> row such as `itu_concrete`, as in a scenario.

    Raises:
        InputError: If USD cannot read the file.
    """
    model = open_stage_model(path)
    found = [*model.problems, *_usd_findings(model), *material_findings(model, material_map or {})]
    found += [*size_findings(model), *lane_findings(model)]
    if model.mesh.faces.size:
        connected = find_components(model)
        found += [*road_findings(model), *coplanar_findings(model)]
        found += [*support_findings(model, connected), *solid_findings(model, connected)]
    order = {severity: k for k, severity in enumerate(SEVERITIES)}
    found.sort(key=lambda finding: (order[finding.severity], finding.rule, finding.path, finding.place or ()))
    return Report(path, tuple(found))


def _usd_findings(model: StageModel) -> list[Finding]:
    return [
        Finding(_SEVERITY[problem.severity], "usd", problem.site, f"{problem.message} [{problem.validator}]")
        for problem in find_problems(model.stage)
    ]
