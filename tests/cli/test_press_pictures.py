"""Pictures of presses go by their labels, whatever a label says."""

from __future__ import annotations

from each import each

from calibration.report.figures import picture_name


@each("label", ["p01", "7", "Druck 3", "прес", "a-b_c+1.5"])
def test_a_plain_label_is_the_name(label: str) -> None:
    assert picture_name(label, 2) == f"{label}.png"


@each("label", ["../../x", "a/b", "<script>", "..", ".hidden", "C:\\x", "a" * 300])
def test_no_label_leads_out_of_the_folder(label: str) -> None:
    name = picture_name(label, 2)
    assert name.startswith("002_")
    assert not set(name) & set("/\\<>:")
    assert len(name.encode()) < 255


def test_two_labels_that_look_alike_keep_their_own_pictures() -> None:
    assert picture_name("a/b", 1) != picture_name("a:b", 2)
