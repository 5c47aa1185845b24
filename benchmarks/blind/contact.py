"""Elastic force of one press against depth, with whatever is hidden in the geometry and in the contact."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from benchmarks.blind import figures, layer
from benchmarks.blind.design import Touch
from benchmarks.blind.world import World
from tactilevision.records.measured import Floats

_EXPANSION = 3.0e-4  # 1/K, of silicone's length
REFERENCE_C = 23.0
_DEPTHS_MM = np.linspace(0, 0.8, 400)

Curves = dict[tuple[float, float], tuple[float, Floats]]


def thickness_at(world: World, touch: Touch) -> float:
    """The gel's true thickness under this press."""
    azimuth = world.shapes.get("wedge_azimuth", 0.0)
    along = touch.place_mm[0] * np.cos(azimuth) + touch.place_mm[1] * np.sin(azimuth)
    true = world.thickness_mm * (1 + world.amount("thickness")) + world.amount("thickness_wedge") * along
    if world.amount("temperature"):
        true *= 1 + _EXPANSION * (touch.temperature_C - REFERENCE_C)
    return float(true)


def elastic_N(world: World, touch: Touch, depth_mm: Floats, known: Curves | None = None) -> Floats:
    """Force of a gel without memory; below 0 depth the straight line goes on, for what clings to be cut from it.

    `known` keeps what presses of one radius and thickness share.
    """
    thickness = thickness_at(world, touch)
    tilt = world.amount("tilt")
    if tilt:
        x, up = layer.askew(round(touch.radius_mm / thickness, 2))
        scale = touch.radius_mm * tilt
        askew = (depth_mm > -scale) & (
            depth_mm < 2.5 * scale
        )  # drawn off further, a face that clings is whole again
        depth_mm = np.where(askew, scale * np.interp(depth_mm / scale, x, up), depth_mm)
    known = {} if known is None else known
    kind = (touch.radius_mm, thickness)
    if kind not in known:
        known[kind] = (_slope(world, *kind), _curve(world, *kind, _DEPTHS_MM))
    slope, curve = known[kind]
    force = np.where(depth_mm > 0, np.interp(depth_mm, _DEPTHS_MM, curve), slope * depth_mm)
    return np.asarray(force * _beside_the_edge(world, touch))


def clinging_mm(world: World, touch: Touch) -> float:
    """How far below 0 the face still holds the gel: where the energy released by a shrinking contact pays for it.

    G = (w^2/2) dK/da / (2 pi a) reaches the work of adhesion; dK/da by differences of the figures.
    """
    work = world.amount("adhesion")
    if work <= 0:
        return 0.0
    a, h, step = touch.radius_mm, thickness_at(world, touch), 0.02
    growth = (_slope(world, a + step, h) - _slope(world, a - step, h)) / (2 * step)
    return float(np.sqrt(2 * work * 2 * np.pi * a / growth))


def _slope(world: World, radius: float, thickness: float) -> float:
    return float(figures.slope_N_per_mm(world.modulus_MPa, world.nu, np.array(radius), np.array(thickness)))


def _curve(world: World, radius: float, thickness: float, depth: Floats) -> Floats:
    force = _upright(world, radius, thickness, depth)
    edge = world.amount("edge_fillet")
    return force * figures.rounded(edge / thickness, depth / thickness, radius / thickness) if edge else force


def _upright(world: World, radius: float, thickness: float, depth: Floats) -> Floats:
    strain, ratio = depth / thickness, np.full(depth.size, radius / thickness)
    force = _slope(world, radius, thickness) * depth * figures.bend(strain, ratio, straight=world.straight)
    rough = world.amount("friction")
    if rough:
        name: figures.Contact = "rough" if rough < 0.5 else "sticks"
        force = force * (1 + rough * (figures.times_frictionless(name, strain, ratio) - 1))
    if world.amount("stiffening"):
        law: figures.Contact = "gent" if world.shape("gent") else "yeoh"
        force = force * (1 + world.amount("stiffening") * (figures.times_frictionless(law, strain, ratio) - 1))
    if world.amount("skin"):
        inertia = (1 + world.amount("skin")) * world.shape("skin_mm") ** 3 / (12 * (1 - layer.NU**2))
        force = force * layer.coat_factor(radius, thickness, inertia)
    return force


def _beside_the_edge(world: World, touch: Touch) -> float:
    """The pad's edge, felt along the punch's rim: the mean over the rim of what fades over half the thickness."""
    size = world.amount("lateral_boundary")
    if not size:
        return 1.0
    return float(1 + size * _rim(world.pad_radius_mm, world.thickness_mm, touch.radius_mm, touch.place_mm))


@lru_cache(maxsize=256)
def _rim(pad: float, thickness: float, radius: float, place: tuple[float, float]) -> float:
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    distance = pad - np.hypot(place[0] + radius * np.cos(turn), place[1] + radius * np.sin(turn))
    return float(np.mean(1 / np.cosh(2 * np.maximum(distance, 0) / thickness) ** 2))
