# SPDX-License-Identifier: Apache-2.0
"""Processes that end with the program that started them."""

from __future__ import annotations

import multiprocessing
import os
import threading
from multiprocessing.connection import wait as wait_for


def end_with_parent() -> None:
    """Let this process end when the one that started it does, however that ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:

        def wait() -> None:
            wait_for([parent.sentinel])
            os._exit(1)

        threading.Thread(target=wait, daemon=True).start()
