"""Runs the code of a page of the documentation, block by block, and compares what it prints.

What a fenced block is, by its first line:

    ```yaml title="FILE"     a file, whatever its language: it is written
    ```bash                  commands; `mmw` and `python -m mmw.run` run in this process, whose kernels are loaded;
                             `# exit code 2` behind one says that it fails, and compares its message too
    ```python                one namespace for the whole page
    ```text                  what the block before it prints; `...` stands for anything, and a number with decimals
                             for itself and those one unit of its last digit away
    <!-- not run: WHY -->    on the line above: the block is left out
    <!-- needs: PACKAGE -->  on the line above: it is left out where the package is not installed

Anything else is an error, so that no block goes untested by accident.
"""

import contextlib
import doctest
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from mmw.__main__ import main

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(
    r"^(?:<!-- (?P<mark>not run|needs): (?P<what>[^\n]+) -->\n)?"
    r"```(?P<language>\w*)(?P<info>[^\n]*)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
DECIMAL = re.compile(r"(?<![\w.])-?\d+\.\d+(?![\w.])")
"""A number with decimals, not a version or part of a name."""
TITLE = re.compile(r' title="([\w./-]+)"')


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    language: str
    title: str
    code: str
    why_not_run: str
    """Empty if it is run."""
    needs: str
    """Package without which it is not run, or empty."""
    line: int


def blocks_of(page: Path) -> list[Block]:
    """Return the fenced blocks of a page, in order."""
    text = page.read_text()
    found = []
    for match in FENCE.finditer(text):
        title = TITLE.fullmatch(match["info"])
        assert title or not match["info"], f"{page.name}: {match['info']!r} after ``` is not understood"
        line = text.count("\n", 0, match.start()) + 1
        what = {match["mark"]: match["what"]}
        why, needs = what.get("not run", ""), what.get("needs", "")
        found.append(Block(match["language"], title[1] if title else "", match["code"], why, needs, line))
    assert text.count("\n```") + text.startswith("```") == 2 * len(found), f"{page.name}: a block is not understood"
    return found


def run_page(page: Path, folder: Path, stand_ins: Mapping[str, Callable[[], None]] | None = None) -> None:
    """Run a page in a folder and compare what it prints with what it says.

    Args:
        page: The page.
        folder: Working directory.
        stand_ins: Command -> what is done in its place; each is called once at least.

    Raises:
        AssertionError: If a block fails, prints something else than the page says, or is not understood.
    """
    names: dict = {"__name__": "__main__"}
    blocks, left = blocks_of(page), set(stand_ins or ())
    told: str | None = ""  # None after a block that was left out
    with contextlib.chdir(folder):
        for block in blocks:
            where = f"{page.name}:{block.line}"
            if block.why_not_run or (block.needs and find_spec(block.needs) is None):
                told = None
            elif block.title:
                Path(block.title).parent.mkdir(parents=True, exist_ok=True)
                Path(block.title).write_text(block.code)
            elif block.language == "text":
                if told is None:
                    continue
                wanted = "\n".join(line.rstrip() for line in block.code.splitlines())
                got = "\n".join(line.rstrip() for line in told.strip("\n").splitlines())
                assert says(wanted, got), f"{where}: the page says\n{wanted}\nbut it prints\n{got}"
            else:
                assert block.language in ("bash", "python"), (
                    f"{where}: give the block a title, or say why not to run it"
                )
                stream = io.StringIO()
                with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(io.StringIO()):
                    if block.language == "python":
                        exec(compile("\n" * block.line + block.code, str(page), "exec"), names)
                    else:
                        for command in _commands(block.code):
                            left.discard(command)
                            _run(command, (stand_ins or {}).get(command), where)
                told = stream.getvalue()
    assert not left, f"{page.name}: no block holds {left}"


def says(wanted: str, got: str) -> bool:
    """Return whether a page says what is printed.

    The last bits of numbers differ between CPUs (`docs/determinism.md`), so one on a rounding boundary, such as -5.75
    in tenths, is printed either way, and a zero with either sign: a number with decimals may be one unit of its last
    printed digit away. Whole numbers and everything else must be as the page has them.
    """
    lines, found = wanted.splitlines(), got.splitlines()
    if len(lines) == len(found):
        pairs = [_with_numbers_of(line, other) for line, other in zip(lines, found, strict=True)]
        lines, found = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    texts = ("\n".join(some) + "\n" for some in (lines, found))
    return doctest.OutputChecker().check_output(*texts, doctest.ELLIPSIS)


def _with_numbers_of(wanted: str, got: str) -> tuple[str, str]:
    """Return both lines, the second with the numbers of the first if all are near enough, and single spaces then."""
    pairs = list(zip(DECIMAL.findall(wanted), DECIMAL.findall(got), strict=False))
    if wanted == got or len(DECIMAL.findall(wanted)) != len(DECIMAL.findall(got)):
        return wanted, got
    for one, other in pairs:
        digits = len(one.partition(".")[2])
        if digits != len(other.partition(".")[2]) or abs(float(one) - float(other)) > 1.01 * 10.0**-digits:
            return wanted, got
    numbers = iter(one for one, _ in pairs)
    same = DECIMAL.sub(lambda _: next(numbers), got)
    return " ".join(wanted.split()), " ".join(same.split())  # a sign that is gone moves what stands beside it


def _commands(code: str) -> list[str]:
    """Return the commands of a block, without comments, lines that end in a backslash joined."""
    lines = re.sub(r"\\\n\s*", "", code).splitlines()
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def _run(command: str, stand_in: Callable[[], None] | None, where: str) -> None:
    if stand_in is not None:
        stand_in()
        return
    words = shlex.split(command, comments=True)
    wanted = re.search(r"# exit code (\d+)", command)
    if words[:3] == ["python", "-m", "mmw.run"]:
        words = ["mmw", "run", *words[3:]]
    if words[0] == "mmw" and not {"|", ">", "&&"} & set(words):
        errors = io.StringIO()
        with contextlib.redirect_stderr(errors):
            code = main(words[1:])
        assert code == int(wanted[1] if wanted else 0), f"{where}: `{command}` ends with {code}: {errors.getvalue()}"
        print(errors.getvalue() if wanted else "", end="")
        return
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    result = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", command],
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, f"{where}: `{command}` ends with {result.returncode}: {result.stderr}"
    print(result.stdout, end="")
