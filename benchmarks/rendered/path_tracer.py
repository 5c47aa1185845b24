"""Radiance of a gel surface under each lamp by itself, by Mitsuba 3, kept on disk.

The camera is orthographic and looks straight down; each pixel is the mean over its square. The transport `path` is
light by up to three reflections, `direct` by one; `unshadowed` is direct light without the shadow ray, so that
every lamp reaches every place that faces it.
Source: Jakob et al., Mitsuba 3 (2022), https://mitsuba-renderer.org.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from benchmarks.rendered.families import Ink, Rig
from benchmarks.rendered.mesh import HeightField, height_field
from tactilevision.files.writing import replacing
from tactilevision.synthetic.gel import Grid, Singles, Surface
from tactilevision.synthetic.lights import Strip

Transport = Literal["path", "direct", "unshadowed"]
_BOUNCES = 4  # longest path: lamp, gel, gel, gel, camera
_INDIRECT_BLUR_PX = 2.0  # of light between gel and gel alone: few paths carry it, and it is smooth


@dataclass(frozen=True, slots=True, eq=False)
class PathTracer:
    """Renders surfaces on the `grid` of the rig's pixels; keeps what it has rendered in `cache`."""

    rig: Rig
    grid: Grid
    cache: Path
    transport: Transport = "path"
    samples: int = 16

    def lamps(self, surface: Surface) -> Singles:
        """Light (H, W, 3) that each of the three lamps sends back to the camera, in a unit of its own."""
        field = height_field(surface, self.grid)
        path = self.cache / f"{self._key(field)}.npz"
        if path.is_file():
            with np.load(path, allow_pickle=False) as stored:
                return np.asarray(stored["light"], dtype=np.float32)
        light = self._render(field)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, light=light.astype(np.float16))
        return light.astype(np.float16).astype(np.float32)

    def _key(self, field: HeightField) -> str:
        rig = self.rig
        lamps = [(lamp.centre_mm, lamp.aim_mm, lamp.length_mm, lamp.width_mm) for lamp in rig.lamps]
        picture = rig.width_px, rig.height_px, rig.mm_per_px
        text = repr((lamps, rig.ink, picture, self.transport, _BOUNCES, _INDIRECT_BLUR_PX, self.samples))
        digest = hashlib.sha256(text.encode())
        for values in (field.x_mm, field.y_mm, field.depth_mm):
            digest.update(np.ascontiguousarray(np.round(values, 6)).tobytes())
        return digest.hexdigest()[:32]

    def _render(self, field: HeightField) -> Singles:
        mi = mitsuba()
        scene = mi.load_dict(
            {
                "type": "scene",
                "gel": _gel(field, self.rig.ink),
                "camera": _camera(self.rig),
                **{f"lamp{i}": _strip(lamp) for i, lamp in enumerate(self.rig.lamps)},
            }
        )
        settings = mi.traverse(scene)
        light = []
        for lit in range(3):
            for i in range(3):
                settings[f"lamp{i}.emitter.radiance.value"] = 100.0 if i == lit else 0.0
                settings[f"lamp{i}.emitter.sampling_weight"] = 1.0 if i == lit else 0.0
            settings.update()
            light.append(self._lamp(scene, seed=lit))
        return np.stack(light, axis=-1).astype(np.float32)

    def _lamp(self, scene: Any, *, seed: int) -> Singles:
        """Light (H, W) of the lamp that is lit.

        Every surface has the same seed, so that noise cancels between two pictures where the surface is the same.
        Light that came by way of other gel is the same paths' light less what came straight.
        """
        if self.transport == "unshadowed":
            return self._drawn(scene, {"type": "unshadowed"}, seed)
        direct = self._drawn(scene, {"type": "path", "max_depth": 2}, seed)
        if self.transport == "direct":
            return direct
        indirect = self._drawn(scene, {"type": "path", "max_depth": _BOUNCES}, seed) - direct
        return direct + np.asarray(cv2.GaussianBlur(indirect, (0, 0), _INDIRECT_BLUR_PX), dtype=np.float32)

    def _drawn(self, scene: Any, integrator: dict[str, Any], seed: int) -> Singles:
        mi = mitsuba()
        drawn = np.array(mi.render(scene, integrator=mi.load_dict(integrator), spp=self.samples, seed=seed))
        return drawn.reshape(drawn.shape[:2])


@lru_cache(maxsize=1)
def mitsuba() -> Any:
    """Mitsuba with its vectorised variant where a fit LLVM is at hand, else its scalar one."""
    try:
        import mitsuba as mi
    except ImportError as fault:
        raise SystemExit("rendering needs Mitsuba 3: pip install '.[render]'") from fault
    try:
        mi.set_variant("llvm_ad_rgb")
        mi.Float(1.0).numpy()  # raises where the library is missing
    except (ImportError, RuntimeError):
        mi.set_variant("scalar_rgb")
    else:
        mi.register_integrator("unshadowed", lambda properties: _unshadowed(mi)(properties))
    return mi


def _unshadowed(mi: Any) -> Any:
    """An integrator of direct light without visibility."""

    class Unshadowed(mi.SamplingIntegrator):  # type: ignore[misc]
        def sample(self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True) -> Any:
            place = scene.ray_intersect(ray, active)
            active = place.is_valid()
            lamp, weight = scene.sample_emitter_direction(place, sampler.next_2d(active), False, active)
            back = place.bsdf(ray).eval(mi.BSDFContext(), place, place.to_local(lamp.d), active)
            return back * weight, active, []

    return Unshadowed


def _gel(field: HeightField, ink: Ink) -> Any:
    mi = mitsuba()
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(_reflectance(ink))
    vertices, faces = field.vertices(), field.faces()
    mesh = mi.Mesh("gel", len(vertices), len(faces), has_vertex_normals=True, props=properties)
    settings = mi.traverse(mesh)
    settings["vertex_positions"] = vertices.ravel()
    settings["vertex_normals"] = field.normals().ravel()
    settings["faces"] = faces.ravel()
    settings.update()
    return mesh


def _reflectance(ink: Ink) -> dict[str, Any]:
    grey = {"type": "rgb", "value": ink.reflectance}
    if ink.kind == "roughplastic":
        return {
            "type": "roughplastic",
            "diffuse_reflectance": grey,
            "alpha": ink.roughness,
            "specular_reflectance": ink.specular,
        }
    if ink.kind == "principled":
        return {"type": "principled", "base_color": grey, "roughness": ink.roughness, "specular": ink.specular}
    return {"type": "diffuse", "reflectance": grey}


def _strip(lamp: Strip) -> dict[str, Any]:
    transform = mitsuba().ScalarTransform4f
    (x, y, z), (to_x, to_y, to_z) = lamp.centre_mm, lamp.aim_mm
    place = transform().look_at(origin=[x, -y, z], target=[to_x, -to_y, to_z], up=[0, 0, 1])
    return {
        "type": "rectangle",
        "to_world": place @ transform().scale([lamp.length_mm / 2, lamp.width_mm / 2, 1]),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 100.0}},
    }


def _camera(rig: Rig) -> dict[str, Any]:
    transform = mitsuba().ScalarTransform4f
    half = rig.width_px * rig.mm_per_px / 2
    return {
        "type": "orthographic",
        "to_world": transform().look_at(origin=[0, 0, 60], target=[0, 0, 0], up=[0, 1, 0])
        @ transform().scale([half, half, 1]),
        "film": {
            "type": "hdrfilm",
            "width": rig.width_px,
            "height": rig.height_px,
            "rfilter": {"type": "box"},
            "pixel_format": "luminance",
            "component_format": "float32",
        },
        "sampler": {"type": "multijitter"},
    }
