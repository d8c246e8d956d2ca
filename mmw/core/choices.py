"""Check that an argument is one of the values that its type names."""

from typing import Any, get_args

from mmw.core.errors import InputError


def check_choice(where: str, value: object, choices: Any) -> Any:
    """Return a value that is one of some names.

    Args:
        where: Place of the value, for the message.
        value: The value.
        choices: A `Literal` of the names.

    Raises:
        InputError: If it is none of them.
    """
    if value not in get_args(choices):
        raise InputError(f"{where} = {value!r}; one of {', '.join(get_args(choices))} is needed; choose one")
    return value
