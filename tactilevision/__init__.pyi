from .batch.folder import reconstruct_folder as reconstruct_folder
from .contact.region import find_contact as find_contact
from .errors import (
    ConvergenceError as ConvergenceError,
    InputError as InputError,
    NothingCertified as NothingCertified,
    OutputError as OutputError,
    RecordingError as RecordingError,
    TactilevisionError as TactilevisionError,
)
from .export.material import (
    ExportedMaterial as ExportedMaterial,
    ExportSettings as ExportSettings,
    export_material as export_material,
)
from .export.shapes import Shape as Shape
from .files.tiff import read_tiff as read_tiff, write_tiff as write_tiff
from .force.calibrated import modulus_of as modulus_of, read_material as read_material
from .force.field import ForceField as ForceField
from .heightmap.batch import HeightMaps as HeightMaps, reconstruct_batch as reconstruct_batch
from .heightmap.build import build_reconstructor as build_reconstructor
from .heightmap.reconstructor import Reconstructor as Reconstructor
from .mechanics.flat_contact import FlatContact as FlatContact
from .mechanics.kappa import kappa as kappa
from .mechanics.material import write_material as write_material
from .mechanics.punch_curve import punch_curve as punch_curve
from .notebook import open_workbench as open_workbench
from .pipeline import (
    calibrate_recording as calibrate_recording,
    compare_recordings as compare_recordings,
    diagnose_recording as diagnose_recording,
    fit as fit,
)
from .press.certification import certify as certify
from .profile.model import Seen as Seen
from .profile.sensor import CalibratedSensor as CalibratedSensor, load_sensor as load_sensor
from .recording.folder import read_folder as read_folder
from .recording.model import BadFrame as BadFrame, Recording as Recording
from .recording.pictures import iter_frames as iter_frames, read_frame as read_frame
from .recording.read import read_recording as read_recording
from .records.certified import CertifiedPoint as CertifiedPoint
from .records.maps import (
    Footprint as Footprint,
    Frame as Frame,
    HeightMap as HeightMap,
    SlopeMap as SlopeMap,
    TractionMap as TractionMap,
)
from .records.measured import (
    Curve as Curve,
    Estimate as Estimate,
    Floats as Floats,
    ForceSeries as ForceSeries,
    Material as Material,
)
from .records.rig import Gel as Gel, Indenter as Indenter, Press as Press, Sensor as Sensor
from .records.taxels import TaxelGrid as TaxelGrid, Taxels as Taxels
from .records.wrench import Patch as Patch, Wrench as Wrench
from .robots.live import Stream as Stream
from .sensors import get_sensor as get_sensor
from .sensors.rectification import (
    find_grid as find_grid,
    rectify as rectify,
    save_rectification as save_rectification,
    sensor_from_corners as sensor_from_corners,
    sensor_from_grid as sensor_from_grid,
)
from .shear.displacement import read_untouched as read_untouched
