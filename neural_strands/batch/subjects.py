"""Reads the subjects of a batch, and the resources of each stage, from a TOML file."""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from neural_strands.batch.storage import is_remote
from neural_strands.fitting.config import FitConfig, Preset, check_fit_config, preset
from neural_strands.foundation.configs import Between, config_from_json, read_settings
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.json_files import JsonValue
from neural_strands.preparation.bounds import FrameCount, LongestSide, MetresPerUnit, PupilDistance

Stage = Literal["prepare", "lmvs", "fit", "evaluate"]
STAGES: tuple[Stage, ...] = get_args(Stage)
"""All stages, in order."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
"""Valid names of subjects, which are also names of folders on any system and in any object store."""
MOST_SUBJECTS = 100_000
ADVICE = "fix the file"


@dataclass(frozen=True)
class PrepareSettings:
    """Options of `prepare`; paths may be URLs of an object store."""

    cameras: str | None = None
    """Known cameras: a folder with a COLMAP model, or transforms.json."""
    landmarks: str | None = None
    """Landmarks set by hand."""
    masks: str | None = None
    """A folder with masks of the hair, named like the photographs."""
    template: str | None = None
    """Head to fit to the person."""
    scalp: str | None = None
    """The template's scalp."""
    detector: str | None = None
    """A Python on every node that has the package mediapipe, if the one that runs the tasks does not."""
    scale: MetresPerUnit | None = None
    """Metres per unit of the cameras."""
    pupil_distance: PupilDistance | None = None
    """Millimetres between the person's pupils."""
    longest_side: LongestSide = 2048
    """Longer side to which larger photographs are reduced, pixels."""
    frames: FrameCount = 80
    """Number of frames to take from a video."""
    bend: bool = True
    """Deform the template to fit the person's face and outline."""


@dataclass(frozen=True)
class Demand:
    """Resources that a task needs: Ray starts it only on a node where they are free."""

    cores: Annotated[int, Between(1, 1024)] = 2
    """Number of processor cores, and of the task's threads; the last bits of figures depend on it."""
    gpu: Annotated[float, Between(0, 1)] | None = None
    """Share of a GPU: 0.5 lets two tasks share one. None: a whole one if the cluster has any, otherwise none."""
    memory: Annotated[float, Between(0.1, 10_000)] = 3.0
    """Gigabytes."""


@dataclass(frozen=True)
class Demands:
    """Resources that the tasks of each stage need."""

    prepare: Demand = field(default_factory=lambda: Demand(gpu=0.0))
    lmvs: Demand = field(default_factory=Demand)
    fit: Demand = field(default_factory=Demand)
    evaluate: Demand = field(default_factory=Demand)

    def of(self, stage: Stage) -> Demand:
        """The demand of a stage."""
        return getattr(self, stage)


@dataclass(frozen=True)
class Subject:
    """One person to reconstruct.

    Attributes:
        name: name of the subject, and of its folder in OUT.
        source: folder of photographs, video, or folder of a capture; absolute, or a URL.
        prepared: whether `source` is a capture.
        config: complete settings of the fit.
        prepare: options of the preparation.
        segments: file of line segments of the training views, if they exist already.
    """

    name: str
    source: str
    prepared: bool
    config: FitConfig = field(default_factory=FitConfig)
    prepare: PrepareSettings = field(default_factory=PrepareSettings)
    segments: str | None = None

    @property
    def stages(self) -> tuple[Stage, ...]:
        """The stages that the subject needs."""
        spared = {"prepare": self.prepared, "lmvs": self.segments is not None}
        return tuple(stage for stage in STAGES if not spared.get(stage, False))

    def as_dict(self) -> dict[str, Any]:
        """Everything that the results depend on, as JSON values."""
        return asdict(self)


@dataclass(frozen=True)
class BatchFile:
    """Contents of a file of subjects.

    Attributes:
        subjects: the subjects, in the order of the file.
        demands: resources of the stages.
    """

    subjects: tuple[Subject, ...]
    demands: Demands


def read_subjects(path: Path) -> BatchFile:
    """Read a file of subjects.

    Relative paths in it are relative to its folder.

    Raises:
        InputError: the file cannot be read or is malformed; whether photographs exist is not checked.
    """
    document = read_settings(path)
    known = ("subjects", "defaults", "resources")
    for name, member in document.members().items():
        if name not in known:
            raise member.refuse(f"no other table than {', '.join(known)}")
    listed = document.member("subjects").members()
    if not 1 <= len(listed) <= MOST_SUBJECTS:
        raise InputError(f"{path}: subjects: expected 1 to {MOST_SUBJECTS}, found {len(listed)}; {ADVICE}.")
    defaults = document.optional("defaults")
    common = {} if defaults is None else defaults.members()
    for name in ("photographs", "capture", "segments"):
        if name in common:
            raise common[name].refuse("defaults that all subjects can share, not the files of one")
    resources = document.optional("resources")
    demands = Demands() if resources is None else config_from_json(Demands(), resources)
    taken: set[str] = set()
    subjects = []
    for name, table in listed.items():
        # Some file systems do not distinguish bob from Bob.
        if NAME.fullmatch(name) is None or name.endswith(".") or name.lower() in taken:
            raise replace(table, value=name).refuse(
                "a name of its own of at most 100 letters, digits, dots, underscores and hyphens"
            )
        taken.add(name.lower())
        table.members()
        under = {} if defaults is None else defaults.value
        subjects.append(_subject(name, replace(table, value=_merged(under, table.value)), path.absolute().parent))
    return BatchFile(tuple(subjects), demands)


def _subject(name: str, table: JsonValue, folder: Path) -> Subject:
    known = ("photographs", "capture", "segments", "preset", "config", "prepare")
    members = table.members()
    for key, member in members.items():
        if key not in known:
            raise member.refuse(f"one of {', '.join(known)}")
    given = [key for key in ("photographs", "capture") if key in members]
    if len(given) != 1:
        raise replace(table, value=sorted(members)).refuse("either photographs or a capture")
    settings = table.optional("config")
    base = preset(members["preset"].choice(get_args(Preset)) if "preset" in members else "fast")
    config = base if settings is None else config_from_json(base, settings)
    check_fit_config(config, f"{table.source}: {table.place}.config")
    options = table.optional("prepare")
    prepared = PrepareSettings() if options is None else config_from_json(PrepareSettings(), options)
    places = ("cameras", "landmarks", "masks", "template", "scalp", "detector")
    found = {key: getattr(prepared, key) for key in places}
    absolute = {key: _place(value, folder) for key, value in found.items() if value is not None}
    return Subject(
        name,
        _place(_path(members[given[0]]), folder),
        given[0] == "capture",
        config,
        replace(prepared, **absolute),
        _place(_path(members["segments"]), folder) if "segments" in members else None,
    )


def _path(written: JsonValue) -> str:
    return written.text() if is_remote(str(written.value)) else written.file_path()


def _place(text: str, folder: Path) -> str:
    """An absolute path, or an unchanged URL."""
    return text if is_remote(text) else str(folder / text)


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Merge two nested tables; values that `over` lacks are those of `base`."""
    both = dict(base)
    for name, value in over.items():
        nested = isinstance(value, dict) and isinstance(both.get(name), dict)
        both[name] = _merged(both[name], value) if nested else value
    return both
