"""`neural-strands batch`: many subjects on one machine or many."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from neural_strands.cli.streams import print_json, say
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError

MOST_NAMES = 5
"""Failed subjects that the closing sentence names."""


@dataclass(frozen=True)
class Batch:
    """Prepare, reconstruct and score many subjects, as tasks of a Ray cluster (extra `batch`).

    Writes OUT/NAME/run for every subject, as `fit` does, and a summary of all, OUT/index.html. When a node dies, its
    tasks continue on others from their last checkpoint; a subject that fails is reported and does not stop the rest.
    The exit status is 0 if all subjects are done.
    """

    subjects: Annotated[Path, tyro.conf.Positional]
    """TOML file with a table `[subjects.NAME]` for each subject: `photographs` or `capture`, and its own settings."""
    out: Annotated[str, tyro.conf.Positional]
    """Folder for the results, which all nodes must see under the same path, or a URL such as s3://bucket/folder."""
    address: str | None = None
    """Cluster to use: `auto` for the one that this machine belongs to, or HOST or HOST:PORT of its head. Default:
    this machine alone."""
    resume: bool = False
    """Continue the batch in OUT: finished stages are kept, failed ones are tried again."""
    retries: Annotated[int, Between(0, 1000)] = 3
    """How often a stage is tried again after its worker or node died."""
    json: bool = False
    """Print one JSON object: for every subject its finished stages, with seconds, memory and figures."""

    def run(self) -> None:
        """Run the batch, showing progress on standard error.

        Raises:
            InputError: nothing could be begun, or subjects have failed.
        """
        from neural_strands.batch.run_batch import BatchRequest, figures, run_batch
        from neural_strands.batch.subjects import read_subjects
        from neural_strands.batch.table import shown, whole

        request = BatchRequest(read_subjects(self.subjects), self.out, self.address, self.resume, self.retries)
        with shown() as show:
            plan = run_batch(request, show, say)
        if self.json:
            print_json(figures(plan, self.out))
        else:
            sys.stdout.write(f"{whole(plan)}: {self.out.rstrip('/')}/index.html\n")
        if failed := list(plan.failures):
            rest = f" and {len(failed) - MOST_NAMES} more" if len(failed) > MOST_NAMES else ""
            raise InputError(
                f"expected all {len(plan.rows)} subjects to be done, found {len(failed)} that failed: "
                f"{', '.join(failed[:MOST_NAMES])}{rest}; fix what {self.out.rstrip('/')}/index.html says about "
                "them, and repeat with --resume."
            )
