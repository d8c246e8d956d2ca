"""What every command does with an error."""

import subprocess
import sys

RAISE = """
import sys
from mmw.command import run_command
def work():
    print("a line")
    raise {error}
sys.exit(run_command(work))
"""


def outcome(error: str) -> tuple[int, str]:
    done = subprocess.run([sys.executable, "-c", RAISE.format(error=error)], capture_output=True, text=True, timeout=60)
    return done.returncode, done.stderr


def test_a_reader_that_has_enough_is_no_error() -> None:
    assert outcome("BrokenPipeError(32, 'Broken pipe')") == (0, "")


def test_other_errors_are_one_line() -> None:
    assert outcome("FileNotFoundError(2, 'No such file', 'a/b')") == (1, "mmw: a/b: No such file\n")
    assert outcome("ValueError('x: 3; name one')") == (2, "mmw: x: 3; name one\n")
