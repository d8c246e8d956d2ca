"""Read and change the radio properties of a material of a scene."""

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

from mmw.core.errors import InputError
from mmw.physics.materials.material import Material, RadioMaterial

if TYPE_CHECKING:
    from mmw.scene.scene_state import SceneState


class MaterialHandle:
    """A material of a scene, as it is in the scene's weathers.

    A change holds in all weathers unless one is named. A changed permittivity needs no new search for paths.
    """

    def __init__(self, scene: "SceneState", name: str, ids: tuple[int, ...]):
        """Refer to a material by its name; `scene.materials` does this."""
        self._scene, self._name, self._ids = scene, name, ids

    def __repr__(self) -> str:
        return f"<material {self._name!r}: {self.radio}>"

    @property
    def name(self) -> str:
        """Name of the USD Material prim."""
        return self._name

    @property
    def ids(self) -> tuple[int, ...]:
        """Material ids with this name, which paths and sensors report."""
        return self._ids

    @property
    def color(self) -> tuple[float, float, float]:
        """Linear diffuse color, 0 to 1."""
        return self._in("").color

    @property
    def radio(self) -> RadioMaterial:
        """Radio material in the scene's first weather; setting it changes all weathers."""
        return self.radio_in()

    @radio.setter
    def radio(self, value: RadioMaterial) -> None:
        self.set_radio(value)

    def radio_in(self, weather: str = "") -> RadioMaterial:
        """Return the radio material in a weather; in the scene's first one if empty.

        Raises:
            InputError: If the scene does not have the weather.
        """
        return self._in(weather).radio

    def set_radio(self, value: RadioMaterial, weather: str = "") -> None:
        """Replace the radio material in a weather; in all of them if empty.

        Raises:
            InputError: If it is no radio material, or the scene does not have the weather.
        """
        if not isinstance(value, RadioMaterial):
            raise InputError(f"material {self._name!r}: radio = {value!r}; a mmw.RadioMaterial is needed; give one")
        self._scene.change_radio(self._ids, lambda old: value, weather)

    def set(self, weather: str = "", **values: Any) -> None:
        """Change some values, such as `relative_permittivity=4.0`, in a weather; in all of them if empty.

        A permittivity or a conductivity makes the material one of constant values; what is not given of the two stays
        that of a constant material, and is 1 and 0 S/m for any other.

        Args:
            weather: Name of a weather.
            values: Fields of `RadioMaterial`.

        Raises:
            InputError: If a field is unknown, or a value is out of range.
        """
        known = [field.name for field in fields(RadioMaterial)]
        for key in values:
            if key not in known:
                raise InputError(
                    f"material {self._name!r}: {key} = {values[key]!r}: no such value; name one of {', '.join(known)}"
                )

        def changed(old: RadioMaterial) -> RadioMaterial:
            try:
                if "model" not in values and values.keys() & {"relative_permittivity", "conductivity"}:
                    return replace(old, **{"model": "constant", "itu": "", **values})
                return replace(old, **values)
            except InputError as error:
                raise InputError(f"material {self._name!r}: {error}") from None

        self._scene.change_radio(self._ids, changed, weather)

    def _in(self, weather: str) -> Material:
        return self._scene.materials_by_id(weather)[self._ids[0]]
