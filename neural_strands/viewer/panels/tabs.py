"""The tabs of a page's panel, for everything that the scene allows."""

from collections.abc import Callable
from pathlib import Path

from neural_strands.runs.run_folder import RunFolder
from neural_strands.viewer.page import Page
from neural_strands.viewer.panels.edit import EditPanel
from neural_strands.viewer.panels.fit import FitPanel
from neural_strands.viewer.panels.look import add_look_panel
from neural_strands.viewer.panels.photographs import add_photographs_panel
from neural_strands.viewer.panels.save import add_save_panel


class Tabs:
    """All tabs of a page."""

    def __init__(self, page: Page) -> None:
        """Fill the panel, replacing its contents.

        Raises:
            InputError: a file of the run is damaged.
        """
        gui, scene = page.server.gui, page.scene
        self._redraw: Callable[[], None]
        self._edit: EditPanel | None = None
        self._fit: FitPanel | None = None
        gui.reset()
        gui.set_panel_label("Neural Strands")
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.add_markdown(f"**{title(scene.path)}** ({scene.kind})" + (f"\n\n{scene.note}" if scene.note else ""))
        tabs = gui.add_tab_group()
        with tabs.add_tab("View"):
            self._redraw = add_look_panel(page)
        if scene.photographs is not None and len(scene.photographs):
            with tabs.add_tab("Photos"):
                add_photographs_panel(page, scene.photographs)
        if scene.fitted is not None and len(scene.fitted.strands):
            with tabs.add_tab("Edit"):
                self._edit = EditPanel(page, scene.fitted, self._redraw)
            with tabs.add_tab("Save"):
                add_save_panel(page)
        if scene.kind == "run":
            with tabs.add_tab("Fit"):
                self._fit = FitPanel(page.server, RunFolder(scene.path))

    def update(self) -> None:
        """Update all tabs after the hair has changed."""
        self._redraw()
        if self._edit is not None:
            self._edit.describe()

    def follow(self) -> None:
        """Show the progress of the fit.

        Raises:
            InputError: its log cannot be read.
        """
        if self._fit is not None:
            self._fit.update()


def title(path: Path) -> str:
    """The last two parts of a path, because the folders of many subjects are all called `run`."""
    return "/".join(path.absolute().parts[-2:]).lstrip("/")
