"""The page of a gel's passport: its change, when to recalibrate, its numbers, and what they rest on."""

from __future__ import annotations

from collections.abc import Iterator

from calibration.report import page, wording
from calibration.report.report import SOURCES
from calibration.tasks.ageing import FIRST, SERIES
from calibration.tasks.passport import NUMBERS, Passport
from tactilevision.records.measured import Estimate

LEVEL_NOTE = (
    f"At most one in 20 series of {SERIES} recordings of a gel that does not age reports a change, looked at "
    f"after each recording from the third on. It takes {FIRST} recordings to tell a drift from scatter."
)
SHA_NOTE = "The SHA-256 of a recording is what this prints in its folder:"
SHA = "find . -type f ! -path '*/.*' | LC_ALL=C sort | xargs -d '\\n' sha256sum | sha256sum"


def percent(found: Estimate) -> str:
    """Return a relative change in per cent with its interval, or why there is none."""
    if found.value is None or found.interval95 is None:
        return f"not determined ({found.why})"
    low, high = (100 * end for end in found.interval95)
    return f"{100 * found.value:+.1f} % (95 %: {low:+.1f} to {high:+.1f} %)"


def passport_lines(found: Passport) -> Iterator[str]:
    """Yield E, the change, and when to recalibrate, as lines for the terminal and the page."""
    last, ageing = found.entries[-1], found.ageing
    yield f"E on {last.date}: {wording.estimate(last.numbers['youngs_modulus_MPa'])}"
    if ageing.change.value is None:
        yield f"change of E: {percent(ageing.change)}"
    else:
        weekly = percent(ageing.rate)
        yield f"change of E at constant ν since {found.entries[0].date}: {percent(ageing.change)}, a week {weekly}"
        since = ageing.reported
        yield "no change is reported" if since is None else f"a change is reported since {since}"
    if ageing.recalibrate_by is not None:
        yield f"recalibrate by {ageing.recalibrate_by}: {ageing.why}"


def passport_page(found: Passport, figure: str) -> str:
    """Return the page; `figure` (HTML) shows the ageing."""
    last = found.entries[-1]
    kind = "verdict found" if found.ageing.reported else "verdict clean" if found.ageing.line else "verdict"
    numbers = [
        (title, wording.estimate(last.numbers[key]), SOURCES.get(last.source(key), last.source(key)))
        for key, title in NUMBERS.items()
    ]
    return page.page(
        f"Passport of {found.sensor}",
        page.block(
            kind,
            *(page.paragraph(line[0].upper() + line[1:]) for line in passport_lines(found)),
            page.paragraph(LEVEL_NOTE, kind="soft"),
        ),
        page.section("Warnings", page.listing(found.warnings)),
        page.section("Over time", figure, _table(found)),
        page.section(f"The gel on {last.date}", page.table(("", "value and 95 % interval", "rests on"), numbers)),
        page.section("Assumptions of the last recording", page.listing(last.kept["assumptions"])),
        page.section("Sources", _sources(found), page.paragraph(SHA_NOTE, kind="soft"), page.command(SHA)),
    )


def _table(found: Passport) -> str:
    names = ("youngs_modulus_MPa", "poisson_ratio", "c_N_per_mm", "temperature_C")
    rows = [
        (str(one.date), one.recording, *(_short(one.numbers[name]) for name in names)) for one in found.entries
    ]
    return page.table(("date", "recording", "E (MPa)", "ν", "c (N/mm)", "temperature (°C)"), rows)


def _short(found: Estimate) -> str:
    """Return the value with its interval, without its unit."""
    fine = found.std
    if found.interval95 is None:
        return "unknown" if found.value is None else wording.number(found.value, fine)
    low, high = found.interval95
    fine = fine or abs(high - low) / 4
    ends = f"{wording.number(low, fine)} to {wording.number(high, fine)}"
    return ends if found.value is None else f"{wording.number(found.value, fine)} ({ends})"


def _sources(found: Passport) -> str:
    rows = [(str(one.date), one.recording, str(one.files), one.sha256) for one in found.entries]
    return page.table(("date", "recording", "files", "SHA-256"), rows, numbers=[2])
