"""Keeps browsers from missing what the page tells them.

viser (1.1) queues messages for a browser in any thread, and a task of its event loop sends them. The thread wakes the
task in two ways: it sets an `asyncio.Event` itself, and it asks the loop to set it. Only the second is allowed. If the
thread sets the event just when the task has found it unset and is about to wait, the loop finds it already set and
wakes nobody. Then that browser hears nothing more until it connects again.
"""

import asyncio
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from viser.infra._async_message_buffer import AsyncMessageBuffer


class LoopEvent(asyncio.Event):
    """An event that only its event loop can set; elsewhere, setting it does nothing."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start unset.

        Args:
            loop: the event loop.
        """
        super().__init__()
        self._home = loop

    def set(self) -> None:
        """Wake those who wait, if called in the event loop."""
        if asyncio._get_running_loop() is self._home:
            super().set()


def wake_in_loop(buffer: "AsyncMessageBuffer") -> None:
    """Let threads leave the waking to the event loop, for a queue of viser's; called in that loop."""
    earlier = buffer.message_event
    if not isinstance(earlier, LoopEvent):
        buffer.message_event = LoopEvent(buffer.event_loop)
        # A task that already waits would wait for ever.
        earlier.set()
