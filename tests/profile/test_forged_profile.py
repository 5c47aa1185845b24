"""A profile that was changed by hand, forged or cut is refused in one sentence."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from each import each
from lamp_sensor import saved

from tactilevision.errors import InputError
from tactilevision.files.writing import write_archive
from tactilevision.profile import storage as contents
from tactilevision.profile.sensor import load_sensor


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("profile"))


def repacked(path: Path, out: Path, change: Callable[[dict[str, bytes]], None], *, hashed: bool = False) -> Path:
    """The profile with its files changed; `hashed`: with hashes that fit, as a forger would."""
    with zipfile.ZipFile(path) as packed:
        files = {name: packed.read(name) for name in packed.namelist()}
    change(files)
    if hashed:
        about = json.loads(files[contents.ABOUT])
        about["files"] = {n: contents.hash_of_bytes(data) for n, data in files.items() if n != contents.ABOUT}
        about[contents.HASH] = contents.hash_of(about)
        files[contents.ABOUT] = json.dumps(about).encode()
    write_archive(out, files)
    return out


def stated(**changes: Any) -> Callable[[dict[str, bytes]], None]:
    """A change of profile.json; dots part the keys."""

    def change(files: dict[str, bytes]) -> None:
        about = json.loads(files[contents.ABOUT])
        for key, value in changes.items():
            *way, last = key.split("__")
            place = about
            for name in way:
                place = place[name]
            place[last] = value
        files[contents.ABOUT] = json.dumps(about).encode()

    return change


@each("name", ["method.npz", "method.json", "untouched.png", "calibration.json", "compliance.npz"])
def test_a_file_that_was_changed_is_named(path: Path, tmp_path: Path, name: str) -> None:
    def change(files: dict[str, bytes]) -> None:
        files[name] = files[name][:-1] + bytes([files[name][-1] ^ 1])

    with pytest.raises(InputError, match=rf"was changed since it was written, or is damaged \(got '{name}'\)"):
        load_sensor(repacked(path, tmp_path / "a.tvs", change))


def test_numbers_changed_by_hand_and_files_taken_out_or_put_in_are_seen(path: Path, tmp_path: Path) -> None:
    changes: tuple[Callable[[dict[str, bytes]], Any], ...] = (
        stated(sensor__mm_per_px=[0.09, 0.09]),
        stated(serial="08"),
        lambda files: files.pop("calibration.json"),
        lambda files: files.update({"more.txt": b"x"}),
    )
    for change in changes:
        with pytest.raises(InputError, match="was changed since it was written"):
            load_sensor(repacked(path, tmp_path / "a.tvs", change))


def as_bytes(content: object) -> bytes:
    return json.dumps(content).encode()


FALSE = {
    "mm_per_px must lie between": stated(sensor__mm_per_px=[0.0, 0.08]),
    "do not fit together: 'str' object cannot be interpreted as an integer": stated(sensor__width_px="240"),
    "reference has another size": stated(sensor__width_px=241),
    "do not fit together: 'sensor'": lambda files: stated_without(files, "sensor"),
    "do not fit together: Invalid isoformat": stated(date="tomorrow"),
    "thickness_mm must lie between": stated(sensor__gel__thickness_mm=-3.0),
    "thickness_mm has the wrong type": stated(sensor__gel__thickness_mm="3"),
    "is not solved": stated(sensor__gel__shape="torus"),
    "do not fit together: .*unexpected keyword": stated(indenters={"A1": {"radius": 2.0}}),
    "followed is one of markers, texture, nothing": stated(sensor__followed="the stars"),
    "beyond the limit": stated(sensor__mm_per_px=[1e13, 1e13]),
    "the profile lacks untouched.png": lambda files: files.pop("untouched.png"),
    "Young's modulus must be above 0": lambda files: in_json(
        files, "calibration.json", "youngs_modulus_MPa", -1.0
    ),
    "is not JSON": lambda files: files.update({"calibration.json": b"{"}),
    "does not match its card": lambda files: in_json(files, "method.json", "sha256", "0"),
    "the array is damaged": lambda files: files.update({"compliance.npz": b"PK"}),
}


def stated_without(files: dict[str, bytes], key: str) -> None:
    about = json.loads(files[contents.ABOUT])
    del about[key]
    files[contents.ABOUT] = json.dumps(about).encode()


def in_json(files: dict[str, bytes], name: str, key: str, value: Any) -> None:
    files[name] = json.dumps(json.loads(files[name]) | {key: value}).encode()


@each("said", FALSE)
def test_a_forged_profile_whose_hashes_fit_is_still_refused(path: Path, tmp_path: Path, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_sensor(repacked(path, tmp_path / "a.tvs", FALSE[said], hashed=True))


@each(
    "version, said",
    [
        (
            2,
            r"is of a newer version: this one reads format 1 \(got 2\)\. Install a newer version of tactilevision",
        ),
        (0, "is not a sensor profile of a known format"),
        (True, "is not a sensor profile of a known format"),
        ("1", "is not a sensor profile of a known format"),
    ],
)
def test_another_version_is_told(path: Path, tmp_path: Path, version: object, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_sensor(repacked(path, tmp_path / "a.tvs", stated(format=version)))


def test_a_part_of_an_earlier_revision_is_refused_by_name(path: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"parts that this version does not read.*lamps\.json"):
        load_sensor(
            repacked(path, tmp_path / "a.tvs", lambda files: files.update({"lamps.json": b"{}"}), hashed=True)
        )


def test_what_is_no_profile_is_told(path: Path, tmp_path: Path) -> None:
    there = tmp_path / "a.tvs"
    with pytest.raises(InputError, match=r"there is no such sensor profile. Make one with `tactilevision calib"):
        load_sensor(there)
    there.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError, match="the archive is damaged"):
        load_sensor(there)
    there.write_text("no zip")
    with pytest.raises(InputError, match="the archive is damaged"):
        load_sensor(there)
    write_archive(there, {"a.txt": b"x"})
    with pytest.raises(InputError, match=r"is not a sensor profile: it holds no profile\.json"):
        load_sensor(there)
    with zipfile.ZipFile(there, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("profile.json", "{}" * 100)
    with pytest.raises(InputError, match="compressed"):
        load_sensor(there)
    with zipfile.ZipFile(there, "w") as packed:
        packed.writestr("profile.json", "{}")
        with pytest.warns(UserWarning, match="Duplicate"):
            packed.writestr("profile.json", "{}")
    with pytest.raises(InputError, match="or one twice"):
        load_sensor(there)
    with pytest.raises(InputError, match="is a folder, not a sensor profile"):
        load_sensor(tmp_path)


def test_what_is_no_profile_is_told_apart(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"no picture")
    for given, said in (
        ("digit", "a kind of sensor"),
        (tmp_path, "a folder"),
        (tmp_path / "a.png", "not a sensor"),
    ):
        with pytest.raises(InputError, match=f"{said}.*Make one with `tactilevision calibrate-sensor"):
            load_sensor(given)
