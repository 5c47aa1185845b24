"""A page on this machine on which circles of ball presses are drawn, checked, and fitted while one looks.

For sensors whose balls are not found. `labels.py` the circles and their table, `session.py` what the page asks,
`outcome.py` what a fit says of each press, `pictures.py` what is seen, `server.py` who may ask.
"""

from tactilevision.profile.guide.server import Guide
from tactilevision.profile.guide.session import Session

__all__ = ["Guide", "Session"]
