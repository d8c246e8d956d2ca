"""Run `python -m mmw.run --config FILE`, which is `mmw run`."""

import sys

from mmw.core.address_space import address_space_problem

if __name__ == "__main__":
    if problem := address_space_problem("run"):
        sys.exit(f"mmw: {problem}")

from mmw.cli.run import main

if __name__ == "__main__":
    sys.exit(main())
