"""Open a USD file that may be missing, broken, hostile, or refer to missing files."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from pxr import Tf, Usd

from mmw.core.errors import InputError
from mmw.usd.schema import register
from mmw.usd.stage_size import check_size

Place = TypeVar("Place", str, Path, str | Path)
Params = ParamSpec("Params")
Value = TypeVar("Value")

LISTED = 8
"""Broken references that an error lists."""


def open_stage(path: Path, load: Usd.Stage.InitialLoadSet = Usd.Stage.LoadAll) -> Usd.Stage:
    """Return a stage; references that do not resolve are left to `check_references`.

    Raises:
        InputError: If there is no such file, USD cannot read it, or it is too large or nested too deeply.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a USD file")
    register()
    with usd_errors(path):
        check_size(path)
        return Usd.Stage.Open(str(path), load)


@contextmanager
def usd_errors(path: Path) -> Iterator[None]:
    """Turn USD's own errors, which a damaged file causes wherever it is read first, into one about the file.

    Raises:
        InputError: With the file, USD's reason, and the prim where USD names one.
    """
    try:
        yield
    except Tf.ErrorException as error:
        text = str(error)
        reasons = (
            re.findall(r" : '(.*)'\s*$", text, re.MULTILINE) or text.strip().splitlines() or ["no reason is given"]
        )
        reason = " ".join(reasons[0].split())  # the others follow from it
        prim = re.search(r"</[^>\n]*>", text)
        where = f"{path}: {prim[0][1:-1]}" if prim else str(path)
        raise InputError(f"{where}: USD cannot read it ({reason[:300]}); give an intact USD file") from None


def reads_usd(function: Callable[Concatenate[Place, Params], Value]) -> Callable[Concatenate[Place, Params], Value]:
    """Wrap a function whose first argument is a USD file in `usd_errors`."""

    @wraps(function)
    def wrapped(path: Place, /, *args: Params.args, **kwargs: Params.kwargs) -> Value:
        with usd_errors(Path(path)):
            return function(path, *args, **kwargs)

    return wrapped


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
