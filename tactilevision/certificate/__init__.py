"""From frames and forces to certified depth and force: clocks, phases, touch of the bevel, checks, certificate."""

from tactilevision.certificate.certificate import Certificate, ContactEvent, Evidence, Finding
from tactilevision.certificate.certify import certify

__all__ = ["Certificate", "ContactEvent", "Evidence", "Finding", "certify"]
