from neural_strands.api import cut as cut
from neural_strands.api import decode as decode
from neural_strands.api import evaluate as evaluate
from neural_strands.api import fit as fit
from neural_strands.api import load_capture as load_capture
from neural_strands.api import load_model as load_model
from neural_strands.api import make_segments as make_segments
from neural_strands.api import render as render
from neural_strands.api import score as score
from neural_strands.api import write_groom as write_groom
from neural_strands.capture.capture import Capture as Capture
from neural_strands.fitting.config import FitConfig as FitConfig
from neural_strands.fitting.config import preset as preset
from neural_strands.foundation.errors import InputError as InputError
from neural_strands.geometry.cameras import Camera as Camera
from neural_strands.geometry.line_segments import LineSegments as LineSegments
from neural_strands.geometry.strands import Strands as Strands
from neural_strands.geometry.turntable import turntable_cameras as turntable_cameras
from neural_strands.grooms.groom import Groom as Groom
from neural_strands.grooms.io import read_groom as read_groom
from neural_strands.model.renderer import HairRenderer as HairRenderer

__all__: list[str]
__version__: str
