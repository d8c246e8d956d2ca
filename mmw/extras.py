"""How to install what is not there: the distribution's name is `multimodal-wireless`, the import's is `mmw`.

`mmw` on the package index is a program of other people. A message that named it would have users install that.
"""

DISTRIBUTION = "multimodal-wireless"
"""Name of this project on the package index; `project.name` in pyproject.toml."""


def install(*extras: str) -> str:
    """Return the command that installs this project with optional packages.

    Args:
        extras: Names under `project.optional-dependencies`, such as `plot`; none for the core alone.
    """
    return f"pip install '{DISTRIBUTION}[{','.join(extras)}]'" if extras else f"pip install {DISTRIBUTION}"
