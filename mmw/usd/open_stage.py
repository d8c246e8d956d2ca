"""Open a USD file that may be missing, broken, or refer to missing files."""

from pathlib import Path

from pxr import Tf, Usd

from mmw.core.errors import InputError
from mmw.usd.schema import register

LISTED = 8
"""Broken references that an error lists."""


def open_stage(path: Path, load: Usd.Stage.InitialLoadSet = Usd.Stage.LoadAll) -> Usd.Stage:
    """Return a stage; references that do not resolve are left to `check_references`.

    Raises:
        InputError: If there is no such file, or USD cannot read it.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a USD file")
    register()
    try:
        return Usd.Stage.Open(str(path), load)
    except Tf.ErrorException as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise InputError(f"{path}: USD cannot read it ({reason}); give an intact USD file") from None


def check_references(stage: Usd.Stage, path: Path) -> None:
    """Check that a stage is whole.

    Raises:
        InputError: If references or payloads do not resolve.
    """
    errors = stage.GetCompositionErrors()
    if errors:
        listed = "\n  ".join(" ".join(str(error).split()) for error in errors[:LISTED])
        raise InputError(
            f"{path}: {len(errors)} references or payloads do not resolve; every layer is needed; repair the paths:"
            f"\n  {listed}"
        )
