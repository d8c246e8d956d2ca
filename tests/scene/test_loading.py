"""The public name `load_scene` stays a function, however often it is looked up."""

import subprocess
import sys

import mmw
import mmw.scene


def test_a_name_is_no_module_after_its_first_use() -> None:
    """A submodule of that name would replace it once it is imported; a fresh process sees the first use."""
    code = "import mmw; first = mmw.load_scene; assert callable(first) and mmw.load_scene is first"
    subprocess.run([sys.executable, "-c", code], check=True)
    for package in (mmw, mmw.scene):
        for name in package.__all__:
            assert getattr(package, name) is getattr(package, name)
            assert type(getattr(package, name)).__name__ != "module", f"{package.__name__}.{name}"
