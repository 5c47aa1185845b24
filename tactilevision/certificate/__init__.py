"""From frames and forces to certified depth and force: clocks, phases, touch of the bevel, checks, certificate."""

from tactilevision.certificate.certificate import Certificate, Evidence, Finding, Touch
from tactilevision.certificate.certify import certify

__all__ = ["Certificate", "Evidence", "Finding", "Touch", "certify"]
