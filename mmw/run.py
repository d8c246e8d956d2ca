"""Run `python -m mmw.run --config FILE`, which is `mmw run`."""

import sys

from mmw.cli.run import main

if __name__ == "__main__":
    sys.exit(main())
