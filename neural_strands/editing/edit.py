"""What an edit is: a frozen dataclass of settings that turns hair into other hair."""

from abc import ABC, abstractmethod

from neural_strands.editing.hair import ScalpShape
from neural_strands.geometry.strands import Strands
from neural_strands.model.hair_model import HairModel


class StrandEdit(ABC):
    """Changes strands, wherever they come from."""

    @abstractmethod
    def edited(self, strands: Strands) -> Strands:
        """The strands after the edit.

        Raises:
            InputError: the settings do not suit these strands.
        """


class TextureEdit(ABC):
    """Changes the scalp texture or its roots, from which a model decodes other strands."""

    @abstractmethod
    def edited(self, shape: ScalpShape, model: HairModel) -> ScalpShape:
        """Texture and roots after the edit.

        Raises:
            InputError: the settings do not suit this model.
        """


Edit = StrandEdit | TextureEdit
