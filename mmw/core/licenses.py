"""Name licenses of data as SPDX does."""

import difflib
import re

from mmw.core.errors import InputError

SPDX_TAG = "SPDX-License-Identifier: "
"""Begin of the line that names a license in a file."""

TITLES = {
    "CC0-1.0": "Creative Commons Zero 1.0 Universal",
    "CC-BY-4.0": "Creative Commons Attribution 4.0 International",
    "CC-BY-SA-4.0": "Creative Commons Attribution Share Alike 4.0 International",
    "CC-BY-NC-4.0": "Creative Commons Attribution Non Commercial 4.0 International",
    "CC-BY-NC-SA-4.0": "Creative Commons Attribution Non Commercial Share Alike 4.0 International",
    "CC-BY-ND-4.0": "Creative Commons Attribution No Derivatives 4.0 International",
    "CDLA-Permissive-2.0": "Community Data License Agreement Permissive 2.0",
    "ODbL-1.0": "Open Data Commons Open Database License v1.0",
    "ODC-By-1.0": "Open Data Commons Attribution License v1.0",
    "PDDL-1.0": "Open Data Commons Public Domain Dedication & License 1.0",
    "Apache-2.0": "Apache License 2.0",
    "MIT": "MIT License",
}
"""SPDX identifier -> name, for licenses that are common for data. Source: the SPDX License List."""

OWN = "LicenseRef-dataset"
"""Identifier that stands for a license that is given as text."""

_IDENTIFIER = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*")


def license_name(text: str) -> str:
    """Return a license as SPDX spells it; other identifiers and texts of several words stay as they are.

    Raises:
        InputError: If it is empty, or an identifier that looks like a misspelled one.
    """
    text = text.strip()
    found = {name.lower(): name for name in TITLES}.get(text.lower())
    if found:
        return found
    if not text:
        raise InputError("is empty; an SPDX identifier such as CC-BY-4.0, or a text is needed")
    near = difflib.get_close_matches(text.lower(), [name.lower() for name in TITLES], 1, 0.8)
    if near and _IDENTIFIER.fullmatch(text):
        known = next(name for name in TITLES if name.lower() == near[0])
        raise InputError(f"{text!r} is no license that is known here; did you mean {known}?")
    return text


def is_identifier(name: str) -> bool:
    """Return whether a license is given by an SPDX identifier rather than by its text."""
    return _IDENTIFIER.fullmatch(name) is not None


def license_file(name: str) -> str:
    """Return the text of the file `LICENSE` of data under a license.

    Args:
        name: Result of `license_name`.
    """
    if not is_identifier(name):
        return f"{SPDX_TAG}{OWN}\n\nThe data in this folder are licensed as follows.\n\n{name}\n"
    title = f"{TITLES[name]} ({name})" if name in TITLES else name
    return (
        f"{SPDX_TAG}{name}\n\nThe data in this folder are licensed under {title}:\n"
        f"https://spdx.org/licenses/{name}.html\n\nNOTICE lists what has to be named with them.\n"
    )


def license_of(text: str) -> str:
    """Return the SPDX identifier that a `LICENSE` file names, empty if it names none."""
    line = next((line for line in text.splitlines() if line.startswith(SPDX_TAG)), "")
    return line.removeprefix(SPDX_TAG).strip()
