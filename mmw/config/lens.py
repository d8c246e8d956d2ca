"""`lens` of a camera: its model, distortion coefficients and, where they are known, focal lengths and optical axis."""

from pydantic import Field, model_validator

from mmw.config.section import Section
from mmw.core.camera_models import Distortion, Intrinsics, LensModel, focal_length
from mmw.core.errors import InputError

WIDEST_DEG = 220.0
"""Largest horizontal field of view, of a fisheye [deg]. Design value: lenses on the market end there."""

USED = {
    "pinhole": (),
    "brown_conrady": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
"""Model -> its coefficients, in OpenCV's order."""

Coefficient = Field(default=0.0, ge=-100, le=100, description="coefficient by OpenCV's name [-]")


class LensConfig(Section):
    """A lens by OpenCV's models; coefficients of a calibration are entered as they are."""

    model: LensModel = Field(
        default="pinhole",
        description="`pinhole`; `brown_conrady`: OpenCV's k1, k2, p1, p2, k3 and, for its rational model, k4 to k6; "
        "`fisheye`: OpenCV's (Kannala-Brandt), k1 to k4 (name)",
    )
    k1: float = Coefficient
    k2: float = Coefficient
    k3: float = Coefficient
    k4: float = Coefficient
    k5: float = Coefficient
    k6: float = Coefficient
    p1: float = Coefficient
    p2: float = Coefficient
    fx_px: float | None = Field(
        default=None,
        gt=0,
        le=1e6,
        description="focal length along rows; given, fov_deg is not used; none: from fov_deg [px]",
    )
    fy_px: float | None = Field(
        default=None, gt=0, le=1e6, description="focal length along columns; none: as fx_px [px]"
    )
    cx_px: float | None = Field(
        default=None,
        ge=0,
        le=8192,
        description="column of the optical axis from the left edge: OpenCV's + 0.5; none: W/2 [px]",
    )
    cy_px: float | None = Field(
        default=None,
        ge=0,
        le=8192,
        description="row of the optical axis from the top edge: OpenCV's + 0.5; none: H/2 [px]",
    )

    @model_validator(mode="after")
    def _own_coefficients(self) -> "LensConfig":
        used = USED[self.model]
        extra = [name for name in USED["brown_conrady"] if name not in used and getattr(self, name) != 0.0]
        if extra:
            raise InputError(
                f"model: {self.model} has {', '.join(used) or 'no coefficients'}, and {extra[0]} = "
                f"{getattr(self, extra[0]):g} is given; leave it out, or choose another model"
            )
        if self.fy_px is not None and self.fx_px is None:
            raise InputError("fy_px is given without fx_px; both, or neither, are needed; add fx_px, or drop fy_px")
        return self

    def distortion(self) -> Distortion:
        """Return the lens without size and focal length."""
        if self.model == "fisheye":
            return Distortion(self.model, radial=(self.k1, self.k2, self.k3, self.k4))
        return Distortion(
            self.model,
            radial=(self.k1, self.k2, self.k3, 0.0),
            rational=(self.k4, self.k5, self.k6),
            tangential=(self.p1, self.p2),
        )

    def intrinsics(self, width_px: int, height_px: int, fov_deg: float) -> Intrinsics:
        """Return the camera of this lens before an image.

        Args:
            width_px: Image width [px].
            height_px: Image height [px].
            fov_deg: Horizontal field of view between the middles of the left and right edges, the tangential part of
                the lens left out; not used where `fx_px` is given [deg].

        Raises:
            InputError: If the optical axis lies outside the image, or the lens has no such field of view.
        """
        distortion = self.distortion()
        fx = focal_length(distortion, width_px, fov_deg) if self.fx_px is None else self.fx_px
        fy = fx if self.fy_px is None else self.fy_px
        cx = 0.5 * width_px if self.cx_px is None else self.cx_px
        cy = 0.5 * height_px if self.cy_px is None else self.cy_px
        if cx > width_px or cy > height_px:
            raise InputError(
                f"lens: the optical axis at ({cx:g}, {cy:g}) lies outside the image of {width_px} x {height_px}; it "
                "must lie inside; correct cx_px and cy_px"
            )
        return Intrinsics(width_px, height_px, fx, fy, cx, cy, distortion)


def check_lens(lens: LensConfig, width_px: int, height_px: int, fov_deg: float) -> None:
    """Check that each pixel of a camera has a direction of its own; the last step of a camera's section.

    Raises:
        InputError: If the lens folds in the image, has no such field of view, or its axis lies outside the image.
    """
    lens.intrinsics(width_px, height_px, fov_deg).reach()
