"""The dataset of the smoke run of `examples.beam_prediction`, made once a process."""

import atexit
import functools
import shutil
import tempfile
from pathlib import Path

from mmw.run import main

FOLDER = Path(__file__).resolve().parent.parent / "examples" / "beam_prediction"


@functools.cache
def smoke_dataset() -> Path:
    """Return the folder of the dataset; nothing may be changed in it."""
    root = Path(tempfile.mkdtemp(prefix="mmw-learn-")) / "dataset"
    atexit.register(shutil.rmtree, root.parent, ignore_errors=True)
    code = main(["--config", str(FOLDER / "dataset_smoke.yaml"), "--out", str(root), "--device", "cpu"])
    assert code == 0
    return root
