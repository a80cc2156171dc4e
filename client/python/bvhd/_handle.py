# SPDX-License-Identifier: Apache-2.0
"""Lifetimes of the library's objects."""
from __future__ import annotations

import ctypes as c
import threading
from typing import Callable, Optional


class Handle:
    """Owns one object of the library, which lives until it is closed and nobody uses it any more.

    A call of the library is a use (``with handle as pointer``), and so is each object that needs
    this one, its children: a client outlives its batches whatever the order in which Python's
    objects end. The call that destroys an object is then the last one on it, as bvhd.h requires.
    """

    def __init__(
        self,
        pointer: c.c_void_p,
        destroy: Callable[[c.c_void_p], None],
        parent: Optional[Handle] = None,
    ) -> None:
        self._pointer = pointer
        self._destroy = destroy
        self._parent = parent
        self._lock = threading.RLock()
        self._uses = 1  # one of them until close
        self._is_open = True
        if parent is not None:
            with parent._lock:
                parent._uses += 1

    @property
    def is_open(self) -> bool:
        return self._is_open

    def __enter__(self) -> c.c_void_p:
        with self._lock:
            if not self._is_open:
                raise ValueError("the object has been closed")
            self._uses += 1
        return self._pointer

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._uses -= 1
            if self._uses > 0:
                return
        self._destroy(self._pointer)
        if self._parent is not None:
            self._parent.__exit__()

    def close(self) -> None:
        """Ends the object as soon as it is not used any more. The second call does nothing."""
        with self._lock:
            if not self._is_open:
                return
            self._is_open = False
        self.__exit__()

    def __del__(self) -> None:
        if hasattr(self, "_is_open"):
            self.close()
