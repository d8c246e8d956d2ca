"""Document the fields of configuration sections, whose text is the `description=` of pydantic's `Field`."""

import ast
from typing import Any

import griffe


class FieldDescriptions(griffe.Extension):
    """Give a field its description as docstring, and its default as value."""

    def on_attribute_instance(self, *, node: Any, attr: griffe.Attribute, **_: Any) -> None:
        """Read the call that a field is assigned, as griffe meets it."""
        call = getattr(node, "value", None)
        if not isinstance(call, ast.Call):
            return
        for keyword in call.keywords:
            if keyword.arg == "description" and isinstance(keyword.value, ast.Constant):
                attr.docstring = attr.docstring or griffe.Docstring(
                    keyword.value.value, lineno=node.lineno, parent=attr
                )
                default = attr.value.arguments[0] if isinstance(attr.value, griffe.ExprCall) else None
                is_default = call.args and not (isinstance(call.args[0], ast.Constant) and call.args[0].value is ...)
                attr.value = default if is_default and ast.unparse(call.func) == "Field" else None
