"""What every command does with an error: one line a problem on stderr, and an exit code.

Exit codes: 0 done, 2 bad input, 1 failure while running.
"""

import os
import sys
from collections.abc import Callable, Sequence

from mmw.config import ConfigError
from mmw.extras import install
from mmw.tables.publish import OutOfSpaceError, StoreError


def fail(problems: Sequence[str], code: int = 2) -> int:
    """Print problems for people and return the exit code."""
    for problem in problems:
        print(f"mmw: {problem}", file=sys.stderr)
    return code


def run_command(work: Callable[[], int], extra: str = "") -> int:
    """Return the exit code of a command, also where it fails.

    Args:
        work: Does it and returns the exit code.
        extra: Optional packages that it needs, such as `plot`; none if empty.
    """
    try:
        return work()
    except ConfigError as error:
        return fail(error.problems)
    except ValueError as error:
        return fail([str(error)])
    except (OutOfSpaceError, StoreError) as error:
        return fail([str(error)], code=1)
    except ImportError as error:
        return fail([f"{error}; this command needs: {install(extra) if extra else install()}"], code=1)
    except BrokenPipeError:  # whoever read the output has enough of it, such as `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python complains when it flushes
        return 0
    except OSError as error:
        return fail([f"{error.filename}: {error.strerror}" if error.filename else " ".join(str(error).split())], code=1)
    except KeyboardInterrupt:
        return fail(["interrupted"], code=1)
