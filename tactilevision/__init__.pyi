from .batch.folder import reconstruct_folder as reconstruct_folder
from .certificate.certify import certify as certify
from .contact.region import find_contact as find_contact
from .errors import (
    ConvergenceError as ConvergenceError,
    InputError as InputError,
    NothingCertified as NothingCertified,
    OutputError as OutputError,
    RecordingError as RecordingError,
    TactilevisionError as TactilevisionError,
)
from .exports.tiff import read_tiff as read_tiff, write_tiff as write_tiff
from .force.calibrated import read_material as read_material
from .force.field import ForceField as ForceField
from .live import Stream as Stream
from .mechanics.export import write_material as write_material
from .mechanics.flat_contact import FlatContact as FlatContact
from .mechanics.kappa import kappa as kappa
from .mechanics.punch_curve import punch_curve as punch_curve
from .profile.seen import Seen as Seen, SeenBatch as SeenBatch
from .profile.sensor import CalibratedSensor as CalibratedSensor, load_sensor as load_sensor
from .reconstruct import Reconstructor as Reconstructor, build_reconstructor as build_reconstructor
from .recording import (
    BadFrame as BadFrame,
    Recording as Recording,
    iter_frames as iter_frames,
    read_folder as read_folder,
    read_frame as read_frame,
    read_recording as read_recording,
)
from .records import (
    CertifiedPoint as CertifiedPoint,
    Curve as Curve,
    Estimate as Estimate,
    Floats as Floats,
    Footprint as Footprint,
    ForceSeries as ForceSeries,
    Frame as Frame,
    Gel as Gel,
    HeightMap as HeightMap,
    Indenter as Indenter,
    Material as Material,
    Press as Press,
    Sensor as Sensor,
    SlopeMap as SlopeMap,
    TractionMap as TractionMap,
    Wrench as Wrench,
)
from .sensors import (
    find_grid as find_grid,
    get_sensor as get_sensor,
    rectify as rectify,
    save_rectification as save_rectification,
    sensor_from_corners as sensor_from_corners,
    sensor_from_grid as sensor_from_grid,
)
from .shear.measure import read_untouched as read_untouched
from .synthetic import simulate as simulate
