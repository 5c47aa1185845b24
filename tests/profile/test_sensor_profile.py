"""A profile says after it was written what it said before, in every process, and is light to load."""

from __future__ import annotations

import pickle
import subprocess
import sys
import tracemalloc
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lamp_sensor import GEL, PUNCH, SHAPE, flat, free, method, picture, pressed, profile, saved

from tactilevision.errors import InputError
from tactilevision.force.field import ForceField, ForceSettings
from tactilevision.heightmap.reconstructor import Reconstructor
from tactilevision.press.certified_faces import DepthScale
from tactilevision.profile.sensor import CalibratedSensor, load_sensor, stated_material
from tactilevision.profile.storage import read_profile, write_profile
from tactilevision.records.certified import TaughtWalls
from tactilevision.records.maps import Frame
from tactilevision.records.rig import Gel, Indenter
from tactilevision.robots.live import Stream


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("profile"))


@pytest.fixture(scope="module")
def sensor(path: Path) -> CalibratedSensor:
    return load_sensor(path)


def test_what_was_written_is_read(path: Path) -> None:
    before, after = profile(), read_profile(path)
    assert after.sensor == before.sensor
    assert after.name == "custom 07"
    assert (after.date, after.source, after.warnings) == (before.date, before.source, before.warnings)
    assert after.indenters == before.indenters
    assert after.material is not None
    assert before.material is not None
    assert after.material.youngs_modulus_MPa == before.material.youngs_modulus_MPa
    np.testing.assert_array_equal(after.material.covariance, before.material.covariance)
    np.testing.assert_array_equal(after.untouched, before.untouched)
    assert after.compliance is not None
    assert before.compliance is not None
    assert after.compliance.slopes is not None
    assert before.compliance.slopes is not None
    np.testing.assert_array_equal(after.compliance.layer.table, before.compliance.layer.table)
    assert after.compliance.slopes is not None
    assert before.compliance.slopes is not None
    np.testing.assert_array_equal(after.compliance.slopes.layer.table, before.compliance.slopes.layer.table)


def test_the_same_profile_gives_the_same_bytes_stored_as_they_are(path: Path, tmp_path: Path) -> None:
    assert saved(tmp_path).read_bytes() == path.read_bytes()
    with zipfile.ZipFile(path) as packed:
        assert all(one.compress_type == zipfile.ZIP_STORED for one in packed.infolist())
    assert saved(tmp_path).read_bytes() == write_profile(read_profile(path), tmp_path / "b.tvs").read_bytes()


def test_depth_and_force_are_those_of_the_method_and_the_material(sensor: CalibratedSensor) -> None:
    rgb = pressed()
    seen = sensor.read(rgb)
    height = Reconstructor(profile().sensor, method().with_reference(method().reference)).height_map(Frame(rgb))
    np.testing.assert_array_equal(seen.height.depth_mm, height.depth_mm)
    np.testing.assert_array_equal(seen.std, height.std_mm)
    material = profile().material
    assert material is not None
    field = ForceField(GEL, material, (0.08, 0.08), settings=ForceSettings(cell_std=False))
    expected = field(height)
    assert seen.tractions is not None
    np.testing.assert_allclose(seen.tractions.t_z, expected.t_z)
    assert seen.wrench is not None
    assert seen.wrench.force_N[2] == pytest.approx(expected.resultant_N[2])
    assert seen.wrench.force_N[2] > 0.1
    assert seen.contact.any()
    assert "shear not measured" in seen.flags


def test_nothing_touches_free_gel(sensor: CalibratedSensor) -> None:
    seen = sensor.read(free(11))
    assert not seen.contact.any()
    assert seen.footprint is None
    assert seen.wrench is not None
    assert seen.wrench.force_N[2] == 0.0
    assert np.isnan(seen.wrench.force_N[:2]).all(), "what was not measured is not 0"
    assert seen.tractions is not None
    assert seen.tractions.could_hide_N > 0


def test_a_batch_is_its_frames(sensor: CalibratedSensor) -> None:
    frames = np.stack([free(11), pressed()])
    seen, one = sensor.read_batch(frames), sensor.read(frames[1])
    assert [each.contact.any() for each in seen] == [False, True]
    np.testing.assert_array_equal(seen[1].height.depth_mm, one.height.depth_mm)
    assert one.tractions is not None
    assert seen[1].tractions is not None
    assert seen[1].tractions.resultant_N[2] == one.tractions.resultant_N[2]
    assert seen[1].flags == one.flags
    with pytest.raises(InputError, match="read_batch"):
        sensor.read(frames)


def test_colours_may_come_in_the_order_of_opencv(sensor: CalibratedSensor) -> None:
    rgb = pressed()
    seen = sensor.read(rgb[..., ::-1], order="bgr")
    np.testing.assert_array_equal(seen.height.depth_mm, sensor.read(rgb).height.depth_mm)
    with pytest.raises(InputError, match=r"no such order \(got 'brg'\)"):
        sensor.read(rgb, order="brg")


def test_a_usual_gel_gives_a_first_force_that_says_so(sensor: CalibratedSensor) -> None:
    """A gel of E .29 +- .145 MPa is known to half of itself, and so is the force."""
    made = profile()
    about = replace(made.sensor, kind="gelsight_mini", gel=None)
    bare = CalibratedSensor(replace(made, sensor=about, calibration=None, compliance=None))
    seen = bare.read(pressed())
    assert "material_assumed" in seen.flags
    assert seen.wrench is not None
    force, std = seen.wrench.force_N[2], seen.wrench.force_std_N[2]
    assert 0.45 < std / force < 1
    known = sensor.read(pressed())
    assert "material_assumed" not in known.flags
    assert known.wrench is not None
    assert abs(force - known.wrench.force_N[2]) < 2 * std
    assert "material_assumed" in seen._repr_html_()


def test_a_frame_of_another_kind_is_refused(sensor: CalibratedSensor) -> None:
    with pytest.raises(InputError, match="another size"):
        sensor.read(free()[:-2])
    with pytest.raises(InputError, match="uint8"):
        sensor.read(free().astype(np.float32))


def test_stream_and_force_field_take_the_sensor(sensor: CalibratedSensor) -> None:
    stream = Stream(sensor)
    moments = [stream.take(Frame(rgb)) for rgb in (free(11), pressed())]
    expected = sensor.read(pressed()).wrench
    assert [moment.contact for moment in moments] == [False, True]
    assert moments[0].wrench is not None
    assert moments[0].wrench.force_N[2] == 0.0
    assert moments[1].wrench is not None
    assert expected is not None
    assert moments[1].wrench.force_N[2] == pytest.approx(expected.force_N[2], rel=0.01)
    assert sensor.field is not None
    assert sensor.field.compliance is sensor.profile.compliance
    assert sensor.field(moments[1].height).resultant_N[2] == pytest.approx(moments[1].wrench.force_N[2])


def test_an_indenter_is_looked_for_and_its_face_held_as_deep_as_certified_ones(path: Path) -> None:
    law = DepthScale((1.1,), (0.05, 0.5), 0.01)
    plain = load_sensor(path, indenter="A1")
    held = CalibratedSensor(replace(profile(), face_law=law), indenter=PUNCH)
    seen, deeper = plain.read(pressed(4, 2.0)), held.read(pressed(4, 2.0))
    assert seen.footprint is not None
    assert deeper.footprint is not None
    assert deeper.height.depth_mm.max() > seen.height.depth_mm.max() + 0.09 * seen.footprint.depth_mm
    moment = Stream(held).take(Frame(pressed(4, 2.0)))
    assert moment.peak_mm == pytest.approx(float(moment.height.depth_mm.max()))
    assert moment.peak_mm > seen.height.depth_mm.max() + 0.09 * seen.footprint.depth_mm
    with pytest.raises(InputError, match=r"no indenter of that name \(got 'B7'\)\. It has: A1"):
        load_sensor(path, indenter="B7")
    ball = Indenter("ball", "sphere", 4.0)
    unlike = CalibratedSensor(replace(profile(), face_law=law), indenter=ball)
    np.testing.assert_array_equal(
        unlike.read(pressed(4, 2.0)).height.depth_mm, seen.height.depth_mm, "a law of flat faces"
    )


def test_a_face_law_is_kept(tmp_path: Path) -> None:
    law = DepthScale((1.02, 0.1), (0.05, 0.5), 0.01)
    there = write_profile(replace(profile(), face_law=law), tmp_path / "a.tvs")
    assert read_profile(there).face_law == law


def test_what_faces_taught_of_walls_is_kept_and_used(tmp_path: Path) -> None:
    taught = replace(method(), walls=TaughtWalls(0.5, 0.1, (0.01, 0.02, 0.001), (0.2, 0.5), 0.03))
    there = write_profile(replace(profile(), method=taught), tmp_path / "a.tvs")
    assert getattr(read_profile(there).method, "walls", None) == taught.walls
    assert load_sensor(there).reconstructor.taught == taught.walls
    assert load_sensor(saved(tmp_path)).reconstructor.taught is None


def test_without_e_and_nu_there_is_depth_and_no_force(tmp_path: Path) -> None:
    bare = replace(profile(), calibration=None, compliance=None)
    sensor = load_sensor(write_profile(bare, tmp_path / "a.tvs"))
    seen = sensor.read(pressed())
    assert seen.tractions is None
    assert seen.wrench is None
    assert Stream(sensor).take(Frame(pressed())).wrench is None
    assert sensor.field is None
    assert stated_material(Gel(3.0)) is None


def test_a_sensor_is_sent_to_other_processes(sensor: CalibratedSensor) -> None:
    again: CalibratedSensor = pickle.loads(pickle.dumps(sensor))  # noqa: S301 - made here
    np.testing.assert_array_equal(again.read(pressed()).height.depth_mm, sensor.read(pressed()).height.depth_mm)


def test_a_newer_reference_takes_the_place_of_the_profiles(sensor: CalibratedSensor) -> None:
    rng = np.random.default_rng(12)
    brighter = [flat(rng, gain=1.1) for _ in range(3)]
    fresh = sensor.with_reference(brighter)
    assert fresh.profile.method.reference.rgb.mean() > 1.05 * profile().method.reference.rgb.mean()
    assert not fresh.read(flat(rng, gain=1.1)).contact.any()


def test_pictures_of_another_unit_are_told(sensor: CalibratedSensor) -> None:
    rng = np.random.default_rng(5)
    nothing = np.zeros(SHAPE)
    turned = tuple((-x, -y, z) for x, y, z in ((-30.0, -4.0, 18.0), (22.0, -24.0, 20.0), (10.0, 30.0, 17.0)))
    others = [picture(nothing, nothing, rng, at=turned) for _ in range(3)]
    fresh = load_sensor(sensor.profile.path)
    assert fresh.look([free(20), pressed(21), free(22)]) == ()
    assert any("is this another unit, gel or light?" in said for said in fresh.look(others))


# a profile that is not as it was written


def test_a_profile_is_written_under_a_name_that_commands_know(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in \.tvs .*Use .*a\.tvs"):
        write_profile(profile(), tmp_path / "a.zip")
    assert list(tmp_path.iterdir()) == []


# what it costs

LOADED = """
import sys
from tactilevision import Frame, Stream, load_sensor
import numpy as np
sensor = load_sensor(sys.argv[1])
heavy = {"torch", "matplotlib", "skimage", "pydantic", "kornia", "onnxruntime", "pandas"} & set(sys.modules)
assert not heavy, heavy
before = set(sys.modules)
frames = np.load(sys.argv[2])
sensor.read_batch(frames)
stream = Stream(sensor)
for rgb in frames:
    stream.take(Frame(rgb))
assert set(sys.modules) == before, set(sys.modules) - before
"""


def test_loading_takes_no_heavy_package_and_a_frame_imports_nothing(path: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "frames.npy", np.stack([free(11), pressed()]))
    command = [sys.executable, "-c", LOADED, str(path), str(tmp_path / "frames.npy")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_reading_frames_keeps_nothing(sensor: CalibratedSensor) -> None:
    frames = [free(11), pressed()]
    tracemalloc.start()
    for rgb in frames * 2:
        sensor.read(rgb)
    before = tracemalloc.get_traced_memory()[0]
    for rgb in frames * 5:
        sensor.read(rgb)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 20_000


def test_frames_of_another_size_are_refused_also_where_the_rectification_would_take_them() -> None:
    made = profile()
    maps = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in SHAPE[::-1]))
    made = replace(made, sensor=replace(made.sensor, rectification=(maps[0], maps[1])))
    larger = np.pad(free(), ((0, 20), (0, 20), (0, 0)), mode="edge")
    for one in (CalibratedSensor(made), CalibratedSensor(made).with_reference([free(5)])):
        assert not one.read(free()).contact.any()
        for take in (one.read, lambda rgb, one=one: Stream(one).take(Frame(rgb))):
            with pytest.raises(InputError, match=f"Hand over frames of {SHAPE[1]} x {SHAPE[0]} px"):
                take(larger)


def test_what_was_doubtful_when_it_was_made_is_said_as_such(sensor: CalibratedSensor) -> None:
    """Its options cannot be given beside a profile."""
    assert f"when {sensor.profile.path.name} was made: made for tests" in sensor.warnings
    assert sensor.with_reference([flat(np.random.default_rng(3))]).warnings[0] == sensor.warnings[0]
