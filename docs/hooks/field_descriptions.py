"""Document the fields of configuration sections, whose text is the `description=` of pydantic's `Field`."""

import ast
from typing import Any

import griffe


class FieldDescriptions(griffe.Extension):
    """Give a field its description as docstring, and its default as value."""

    def on_attribute_instance(self, *, node: Any, attr: griffe.Attribute, **_: Any) -> None:
        """Read the call that a field is assigned, as griffe meets it."""
        if not isinstance(attr.value, griffe.ExprCall):
            return
        given = {one.name: one.value for one in attr.value.arguments if isinstance(one, griffe.ExprKeyword)}
        if "description" in given:
            text = ast.literal_eval(str(given["description"]))
            attr.docstring = attr.docstring or griffe.Docstring(text, lineno=node.lineno, parent=attr)
            attr.value = given.get("default")
