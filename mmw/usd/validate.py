"""Check a stage with USD's own validators; `usd-core` ships neither `usdchecker` nor a compliance checker."""

from dataclasses import dataclass

from pxr import Usd, UsdValidation

from mmw.usd import schema


@dataclass(frozen=True, order=True)
class Problem:
    """One finding of USD's validators."""

    severity: str
    """`error`, `warn` or `info`."""
    site: str
    """Prims, properties or layers that it is about, separated by commas."""
    message: str
    validator: str
    """Name of the error, such as `usdShadeValidators:...MissingMaterialBindingAPI`."""

    def __str__(self) -> str:
        """Return one line for people."""
        return f"{self.severity}: {self.site}: {self.message} [{self.validator}]"


def find_problems(stage: Usd.Stage) -> list[Problem]:
    """Return the findings of USD's validators on a stage whose payloads are loaded; empty for a clean stage."""
    schema.register()
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    findings = UsdValidation.ValidationContext(validators).Validate(stage)
    return sorted(_problem(finding) for finding in findings if not finding.HasNoError())


def validate_stage(stage: Usd.Stage) -> list[str]:
    """Return the problems of `find_problems`, one line each."""
    return [str(problem) for problem in find_problems(stage)]


def _problem(finding: UsdValidation.ValidationError) -> Problem:
    sites = ", ".join(_site_name(site) for site in finding.GetSites())
    severity = str(finding.GetType()).rsplit(".", 1)[-1].lower()
    return Problem(severity, sites, finding.GetMessage(), str(finding.GetName()))


def _site_name(site: UsdValidation.ValidationErrorSite) -> str:
    if site.IsPrim() or site.IsProperty():
        return str((site.GetPrim() if site.IsPrim() else site.GetProperty()).GetPath())
    layer = site.GetLayer()
    return layer.identifier if layer else "stage"
