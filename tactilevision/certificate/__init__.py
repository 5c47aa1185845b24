"""From frames and forces to certified depth and force.

Each folder or file imports only those before it:

1. `force`: readings of one press, tared, by phase; the first contact from the force.
2. `clock`: offset of the F/T sensor's clock against the camera's.
3. `touch`: contact event of the bevel, and the travel scale that orders events.
4. `depth`: pile-up, edge profile and depth scale; the depth that an event certifies.
5. `rejection`, `recording_statistics`: whether a press can be trusted.
6. `certified_point`, `certificate`, `evidence`: what a press and a recording yield.
7. `assemble`, `certify`: the whole recording; `surface_beside_punch`, `poisson_from_rise`, `step_validation`:
   what rests on it.

A benchmark or test named beside a constant is where a change of it shows; it does not derive the value.
"""

from tactilevision.certificate.certificate import Certificate, Evidence
from tactilevision.certificate.certify import certify
from tactilevision.certificate.rejection import Finding
from tactilevision.certificate.touch.contact_event import ContactEvent

__all__ = ["Certificate", "ContactEvent", "Evidence", "Finding", "certify"]
