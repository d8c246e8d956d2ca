"""Check a stage with USD's own validators; `usd-core` ships neither `usdchecker` nor a compliance checker."""

from pxr import Usd, UsdValidation

from mmw.usd import schema


def validate_stage(stage: Usd.Stage) -> list[str]:
    """Return what USD's validators find wrong with a stage, after composition.

    Args:
        stage: The stage, with its payloads loaded.

    Returns:
        One line a finding: severity, validator, site and message; an empty list for a clean stage.
    """
    schema.register()
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    findings = UsdValidation.ValidationContext(validators).Validate(stage)
    return sorted(_line(finding) for finding in findings if not finding.HasNoError())


def _line(finding: UsdValidation.ValidationError) -> str:
    sites = ", ".join(_site_name(site) for site in finding.GetSites())
    severity = str(finding.GetType()).rsplit(".", 1)[-1].lower()
    return f"{severity}: {sites}: {finding.GetMessage()} [{finding.GetName()}]"


def _site_name(site: UsdValidation.ValidationErrorSite) -> str:
    if site.IsPrim():
        return str(site.GetPrim().GetPath())
    if site.IsProperty():
        return str(site.GetProperty().GetPath())
    layer = site.GetLayer()
    return layer.identifier if layer else "stage"
