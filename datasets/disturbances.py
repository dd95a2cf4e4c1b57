"""What spoils videos: each disturbance has a size, and all come from one seed."""

from dataclasses import dataclass, fields
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array

Grey = NDArray[np.float32]
_MARGIN_PX = 128  # by which a pattern is wider than the image that is cut out of it; chosen
_BAR_GREY, _BAR_PX = 18.0, 8
_SKIN_PX, _SKIN_GREY = 64, 25.0


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """How a video is spoilt; the default is a sharp video of a dark room in which the body hides markers.

    Attributes:
        occlusion: 1: markers that body or membranes hide are not drawn; 0: they shine through.
        bars: Number of dark bars between camera and animal, 8 px wide (a cage); they hide markers too.
        exposure: Time for which the shutter is open, as a share of a frame: motion blur.
        defocus_px: Standard deviation of the blur of a lens out of focus.
        noise: Standard deviation of the camera's noise in the dark, in grey levels of 255.
        shot: Standard deviation of the noise in white, in grey levels; it grows with the root of the brightness.
        flicker: Relative amplitude of the lamps' changes, as of mains light against the frame rate.
        reflections: Number of spots that look like markers, half of them at rest on the walls, half moving with the
            animal's bones; each is there for half of the time.
        radius_px: Radius of a marker's dot: great ones merge with their neighbours.
        contrast: Contrast of the dots against bone, 1: white ones.
        compression: Constant rate factor of H.264; 0 loses nothing, 23 is usual, 40 is poor.
        background: Amplitude of the background's texture (foliage, scratches), in grey levels.
        unpainted: Markers that have no dot, but skin with a texture (scales, fur) about them.
    """

    occlusion: float = 1.0
    bars: int = 0
    exposure: float = 0.0
    defocus_px: float = 0.0
    noise: float = 3.0
    shot: float = 0.0
    flicker: float = 0.0
    reflections: int = 0
    radius_px: float = 3.0
    contrast: float = 1.0
    compression: int = 23
    background: float = 0.0
    unpainted: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the sizes.

        Raises:
            ValueError: a size is negative, or no radius, or a share is above 1.
        """
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name == "unpainted":
                continue
            if not value >= 0 or (entry.name in ("occlusion", "exposure", "contrast", "flicker") and value > 1):
                limit = "from 0 to 1" if entry.name in ("occlusion", "exposure", "contrast", "flicker") else "0 or more"
                raise ValueError(f"{entry.name} of a video must be {limit}, but is {value:g}")
        if self.radius_px == 0:
            raise ValueError("radius_px of a video's dots must be above 0")


CLEAN = Disturbances()
SINGLE = {
    "occlusion": Disturbances(bars=6),
    "blur": Disturbances(exposure=0.25),
    "defocus": Disturbances(defocus_px=1.5),
    "noise": Disturbances(noise=8.0, shot=8.0),
    "flicker": Disturbances(flicker=0.3),
    "reflections": Disturbances(reflections=20),
    "merging": Disturbances(radius_px=5.0),
    "compression": Disturbances(compression=38),
    "background": Disturbances(background=20.0),
}
"""One disturbance each."""
ALL = Disturbances(
    bars=3,
    exposure=0.15,
    defocus_px=1.0,
    noise=5.0,
    shot=5.0,
    flicker=0.2,
    reflections=12,
    radius_px=3.5,
    compression=30,
    background=12.0,
)
"""All of them, each of a moderate size."""
TEXTURE = Disturbances(unpainted=("spine", "head"))
"""Two points of head and back to follow by their texture, in an otherwise clean video."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Spoiler:
    """The disturbances of one camera's video.

    Attributes:
        sizes: How great they are.
        size_px: Width and height.
        n_frames: Number of frames.
        n_bones: Number of bones that reflections may ride on.
        seed: Of all that is random, one for each camera.
    """

    sizes: Disturbances
    size_px: tuple[int, int]
    n_frames: int
    n_bones: int
    seed: tuple[int, ...]

    def _rng(self, what: int) -> np.random.Generator:
        return np.random.default_rng([*self.seed, what])

    @cached_property
    def bars(self) -> Array:
        """(B, 3) lines a u + b v + c = 0 with a^2 + b^2 = 1, of the middles of bars."""
        rng, (width, height) = self._rng(1), self.size_px
        angle = rng.normal(0, 0.25, self.sizes.bars)
        through = rng.uniform([0.1 * width, 0.5 * height], [0.9 * width, 0.5 * height], (self.sizes.bars, 2))
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.column_stack([normal, -np.sum(normal * through, axis=1)])

    def behind_bars(self, uv: Array) -> NDArray[np.bool_]:
        """(...) True where a place (..., 2), counted from 0, is behind a bar: its dot is more than half covered."""
        covered = np.zeros(uv.shape[:-1], dtype=np.bool_)
        for a, b, c in self.bars:
            covered |= np.abs(a * uv[..., 0] + b * uv[..., 1] + c) < _BAR_PX / 2
        return covered

    @cached_property
    def texture(self) -> Grey:
        """(height, width) of the background, about 0: noise of several sizes."""
        rng, (width, height) = self._rng(2), self.size_px
        total = np.zeros((height, width), dtype=np.float32)
        if self.sizes.background:
            for cell in (4, 12, 48):
                coarse = rng.standard_normal((height // cell + 2, width // cell + 2), dtype=np.float32)
                total += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
            total *= np.float32(self.sizes.background / total.std())
        return total

    def skin(self, marker: int) -> Grey:
        """(64, 64) texture about a marker, about 0, the same in all videos: noise of two sizes."""
        rng = np.random.default_rng([self.seed[0], 8, marker])
        total = np.zeros((_SKIN_PX, _SKIN_PX), dtype=np.float32)
        for cell in (5, 10):
            coarse = rng.standard_normal((_SKIN_PX // cell + 2,) * 2, dtype=np.float32)
            total += cv2.resize(coarse, (_SKIN_PX, _SKIN_PX), interpolation=cv2.INTER_CUBIC)
        return np.asarray(total * np.float32(_SKIN_GREY / total.std()), dtype=np.float32)

    @cached_property
    def _grain(self) -> Grey:
        """A sheet of noise, larger than the image, of which each frame shows another part."""
        width, height = self.size_px
        return self._rng(3).standard_normal((height + _MARGIN_PX, width + _MARGIN_PX), dtype=np.float32)

    @cached_property
    def light(self) -> Array:
        """(T,) brightness of the lamps, about 1: a beat of the mains and chance."""
        rng = self._rng(4)
        beat = np.sin(2 * np.pi * (rng.random() + np.arange(self.n_frames) * rng.uniform(0.05, 0.2)))
        return 1 + self.sizes.flicker * (0.7 * beat + 0.3 * rng.uniform(-1, 1, self.n_frames))

    @cached_property
    def _spots(self) -> tuple[Array, NDArray[np.int64], Array, Array]:
        """Places of those at rest (K, 2), bones (L,) and shares along them (L,), and phases of when they shine."""
        rng, n = self._rng(5), self.sizes.reflections
        still = n // 2
        return (
            rng.uniform(0, 1, (still, 2)) * self.size_px,
            rng.integers(0, max(self.n_bones, 1), n - still),
            rng.uniform(0.3, 0.7, n - still),
            rng.uniform(0, 1, n),
        )

    def spots(self, frame: int, bones: Array) -> Array:
        """(N, 2) places of reflections in a frame.

        Args:
            frame: Number of the frame.
            bones: (K, 2, 2) ends of the bones in the image.
        """
        still, bone, along, phase = self._spots
        shines = np.mod(phase + frame / 40.0, 1.0) < 0.5
        moving = still[:0]
        if len(bones):
            moving = bones[bone, 0] * (1 - along[:, None]) + bones[bone, 1] * along[:, None]
        return np.concatenate([still[shines[: len(still)]], moving[shines[len(still) :][: len(moving)]]])

    def spoilt(self, drawn: Grey, frame: int) -> NDArray[np.uint8]:
        """What the camera makes of light: defocus, bars, flicker, noise, whole grey levels.

        Args:
            drawn: (height, width) grey levels; changed.
            frame: Number of the frame.
        """
        sizes, (width, height) = self.sizes, self.size_px
        for a, b, c in self.bars:
            # two points of the line far above and below the image
            ends = [(-(b * v + c) / a, v) for v in (-100.0, height + 100.0)]
            (u0, v0), (u1, v1) = ends
            cv2.line(drawn, (round(u0), round(v0)), (round(u1), round(v1)), _BAR_GREY, _BAR_PX, cv2.LINE_AA)
        if sizes.defocus_px > 0:
            drawn = np.asarray(cv2.GaussianBlur(drawn, (0, 0), sizes.defocus_px), dtype=np.float32)
        if sizes.flicker > 0:
            drawn = drawn * np.float32(self.light[frame])
        if sizes.noise > 0 or sizes.shot > 0:
            rng = np.random.default_rng([*self.seed, 6, frame])
            u, v = rng.integers(0, _MARGIN_PX, 2)
            grain = self._grain[v : v + height, u : u + width]
            if rng.random() < 0.5:
                grain = grain[:, ::-1]
            variance = np.maximum(drawn, 0) * np.float32(sizes.shot**2 / 255) + np.float32(sizes.noise**2)
            drawn = drawn + (np.sqrt(variance) * grain).astype(np.float32)
        return np.asarray(cv2.convertScaleAbs(np.maximum(drawn, 0)), dtype=np.uint8)
