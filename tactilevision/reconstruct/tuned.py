"""A calibration made to fit the free gel of its sensor, its errors measured on its own ball pictures."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from tactilevision.photometric import BallPicture, Calibration
from tactilevision.photometric.ball.detection import Ball
from tactilevision.photometric.ball.samples import far_from
from tactilevision.quality.inconsistent_light import measured_light
from tactilevision.quality.reference_match import baseline
from tactilevision.reconstruct.reconstructor import Reconstructor
from tactilevision.reconstruct.untouched_frames import subtract_background, tare, untouched_of
from tactilevision.records import Bytes, Sensor
from tactilevision.uncertainty.ball_validation import held_out_depth, seen_gain_std
from tactilevision.uncertainty.depth import contributions_mm
from tactilevision.uncertainty.leakage import leakage_share
from tactilevision.uncertainty.untouched_gel import untouched_std_mm

MAX_WAVES = 8  # pictures with balls that are looked at, at most


def tuned(
    sensor: Sensor, calibration: Calibration, *, pictures: Sequence[BallPicture], free: Sequence[Bytes]
) -> Reconstructor:
    """The reconstructor of a calibration, made to fit rectified frames of the free gel, its errors measured.

    How far untouched gel is from flat is told, place by place, by the `free` frames where there are enough of
    them, else by the ball pictures.
    """
    gain = seen_gain_std(calibration.method, pictures, balls=calibration.balls, mm_per_px=sensor.mm_per_px)
    card = dataclasses.replace(calibration.method.card, sensor=sensor.kind, seen_gain_std=gain)
    card = card.extended(held_out_depth(calibration, pictures, mm_per_px=sensor.mm_per_px, seen_gain=gain))
    factor = float(card.other.get("depth_coverage_factor", 1.0))
    place_gain = np.round(factor * np.array(card.place_gain_std), 5).tolist()
    card = dataclasses.replace(card, seen_gain_std=factor * gain, place_gain_std=place_gain)
    card = dataclasses.replace(card, leakage_std=_spread(sensor, calibration, pictures))
    method = dataclasses.replace(calibration.method, card=card)
    settled = subtract_background(dataclasses.replace(method, reference=tare(method, free)), free)
    if settled.background is method.background:
        waves_mm = untouched_rms_mm(Reconstructor(sensor, method), pictures, balls=calibration.balls)
        settled = settled.with_card(dataclasses.replace(card, untouched_depth_rms_mm=waves_mm))
    else:
        reader = Reconstructor(sensor, settled)
        flat = [reader.rectified_map(rgb).depth_mm for rgb in untouched_of(method, free)]
        std_mm = np.round(untouched_std_mm(flat), 6).tolist()
        settled = settled.with_card(dataclasses.replace(settled.card, untouched_std_mm=std_mm))
    light = measured_light(
        settled, pictures, balls=calibration.balls, free=untouched_of(settled, free), mm_per_px=sensor.mm_per_px
    )
    settled = dataclasses.replace(settled, light_law=light)
    reader = Reconstructor(sensor, settled)
    usual = baseline(reader.match_residuals, [*(picture.rgb for picture in pictures), *free])
    terms = depth_terms_mm(Reconstructor(sensor, settled), pictures, balls=calibration.balls)
    settled = settled.with_card(dataclasses.replace(settled.card, baseline=usual, depth_terms_mm=terms))
    return Reconstructor(sensor, settled, calibration=calibration)


def depth_terms_mm(
    reader: Reconstructor, pictures: Sequence[BallPicture], *, balls: Sequence[Ball | None]
) -> dict[str, float]:
    """What each term adds to the deviation of depth under a ball: rms in mm, the median over ball pictures."""
    found = []
    for picture, ball in list(zip(pictures, balls, strict=True))[:MAX_WAVES]:
        if ball is not None:
            height = reader.rectified_map(picture.rgb)
            found.append(contributions_mm(height, reader.depth_terms(height)))
    return {name: round(float(np.median([one[name] for one in found])), 6) for name in found[0]} if found else {}


def _spread(sensor: Sensor, calibration: Calibration, pictures: Sequence[BallPicture]) -> float:
    """How far errors of slope reach beside a contact, by laws that never saw a third of the balls."""
    method = calibration.method
    others = [dataclasses.replace(method, law=law) for law in calibration.other_laws]
    maps = [partial(_depth, Reconstructor(sensor, made)) for made in (method, *others)]
    gain = np.array(method.card.place_gain_std) / method.card.coverage_factor
    return leakage_share(maps, pictures, balls=calibration.balls, gain=gain, mm_per_px=sensor.mm_per_px)


def _depth(reader: Reconstructor, rgb: Bytes) -> npt.NDArray[Any]:
    return reader.rectified_map(rgb).depth_mm


def untouched_rms_mm(
    reconstructor: Reconstructor, pictures: Sequence[BallPicture], *, balls: Sequence[Ball | None]
) -> float:
    """How far from flat untouched gel comes out: the median over ball pictures, away from the ball, mm."""
    found = []
    for picture, ball in list(zip(pictures, balls, strict=True))[:MAX_WAVES]:
        if ball is not None:
            height = reconstructor.rectified_map(picture.rgb)
            away = far_from(ball, height.depth_mm.shape, mm_per_px=reconstructor.sensor.mm_per_px) & height.valid
            if away.any():
                found.append(float(np.sqrt(np.mean(np.square(height.depth_mm[away])))))
    return float(np.median(found)) if found else 0.0
