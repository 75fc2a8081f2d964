# SPDX-License-Identifier: MIT
"""Errors, the context and what turns numbers into what C takes."""
from __future__ import annotations

import difflib
import logging
import os
import re
import sys
import threading
import warnings
from typing import Any, Callable, Iterable, Optional

import numpy as np

from ._pellucid import ffi, lib

Progress = Callable[[str, float], Any]
_logger = logging.getLogger("pellucid")


def path_bytes(path: Any, what: str = "path") -> bytes:
    """A str, bytes or PathLike as C takes it. InvalidError: C would see its part before a NUL alone."""
    try:
        data = os.fsencode(path)
    except (TypeError, ValueError):
        raise wrong(what, f"is {path!r:.60}, must be a str, bytes or a path") from None
    if b"\0" in data:
        raise wrong(f"{what} {path!r:.60}", "has a NUL byte, must have none")
    return data


def encoded(value: Any, what: str) -> bytes:
    """A text as C takes it. InvalidError: C would see its part before a NUL alone."""
    if not isinstance(value, str):
        raise wrong(what, f"is {value!r:.60}, must be a text")
    if "\0" in value:
        raise wrong(what, f"is {value!r:.60}, has a NUL character, must have none")
    try:
        return value.encode()
    except UnicodeEncodeError as e:
        raise wrong(what, f"is {value!r:.60}, must be characters of Unicode: {e.reason}") from None


# What an argument is said to be begins with one of these.
_PREDICATES = ("is ", "has ", "must ", "goes ", "gives ", "can't ", "does ")


class Error(Exception):
    """A call failed: `where` it was found, `what` is wrong with the value and what is allowed, and a `hint`, which may be "". `function`:
    the function or class of this package that refused an argument, which `where` names; else ""."""

    code = 0

    def __init__(self, what: str, where: str = "", hint: str = "", function: str = ""):
        if not function:
            said = ": ".join(filter(None, (where, what)))
        elif not where or what.startswith((f"{where} ", f"there is no {where} ")):  # the sentence names it
            said = f"{function}: {what}"
        else:
            said = f"{function}: {where}{' ' if what.startswith(_PREDICATES) else ': '}{what}"
        super().__init__(said + (f" ({hint})" if hint else ""))
        self.where, self.what, self.hint, self.function = where, what, hint, function


class InvalidError(Error, ValueError):
    """A value is out of range."""
    code = lib.PELL_ERR_INVALID


class OutOfMemoryError(Error, MemoryError):
    """Out of memory, or over the context's limit."""
    code = lib.PELL_ERR_NOMEM


class FileError(Error, OSError):
    """A file can't be opened, read or written."""
    code = lib.PELL_ERR_IO


class FormatError(Error, ValueError):
    """A file is damaged or breaks its format's rules."""
    code = lib.PELL_ERR_FORMAT


class UnsupportedError(Error):
    """Well formed, but not supported."""
    code = lib.PELL_ERR_UNSUPPORTED


class DeviceError(Error):
    """The engine or device does not exist, or was lost."""
    code = lib.PELL_ERR_DEVICE


class CancelledError(Error):
    """The work was cancelled by Context.cancel."""
    code = lib.PELL_ERR_CANCELLED


class PellucidWarning(UserWarning):
    """The library continues, but the result may not be as intended."""


_errors = {e.code: e for e in (InvalidError, OutOfMemoryError, FileError, FormatError, UnsupportedError, DeviceError, CancelledError)}
for _public in (Error, *_errors.values(), PellucidWarning):
    _public.__module__ = "pellucid"  # as callers name it


class Value:
    """An object whose state is its attributes and a C struct without pointers, `c`: it can be copied and pickled. Values are equal if what
    _parts() gives is."""

    c: Any
    _struct = ""

    def _parts(self) -> tuple:
        raise NotImplementedError

    def __eq__(self, other) -> bool:
        return self._parts() == other._parts() if type(self) is type(other) else NotImplemented

    def __hash__(self) -> int:
        return hash((type(self).__name__, self._parts()))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "c": bytes(ffi.buffer(self.c))}

    def __setstate__(self, state: dict[str, Any]) -> None:
        data, made = state["c"], ffi.new(f"{self._struct} *")
        if len(data) != ffi.sizeof(self._struct):
            raise InvalidError("was pickled by another version of the library, and can't be read by this one", type(self).__name__)
        ffi.memmove(made, data, len(data))
        self.__dict__.update({**state, "c": made})


def text(pointer) -> str:
    return ffi.string(pointer).decode("utf-8", "replace") if pointer else ""


def failure(code: int, what: str = "", where: str = "", hint: str = "", function: str = "") -> Error:
    return _errors.get(code, Error)(what or text(lib.pell_result_name(code)), where, hint, function)


def called() -> str:
    """What the caller called: the outermost function of this package on the stack, as "Scene.load", or the class that it makes."""
    frame: Any = sys._getframe(1)  # pylint: disable=protected-access # no other way to the caller's name
    name = ""
    while frame and frame.f_globals.get("__name__", "").split(".")[0] == __package__:
        function, own = frame.f_code.co_name, frame.f_locals
        owner = type(own["self"]) if "self" in own else own.get("cls")
        if not function.startswith("<"):  # a comprehension
            name = function if not isinstance(owner, type) else \
                owner.__name__ if function in ("__init__", "__call__") else f"{owner.__name__}.{function}"
        frame = frame.f_back
    return name


def outside() -> int:
    """The stacklevel of warnings.warn, in the function that asks, for the line that called this package."""
    frame: Any = sys._getframe(1)  # pylint: disable=protected-access # no other way to the caller
    level = 1
    while frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] == __package__:
        frame, level = frame.f_back, level + 1
    return level


def wrong(argument: str, what: str, hint: str = "") -> Error:
    """The error of an argument, as a sentence: "Medium: sigma_a is -1, must be in [0, 1000]"."""
    return failure(lib.PELL_ERR_INVALID, what, argument, hint, called())


def closed(what: str) -> Error:
    """The error of an object that is used after close()."""
    return InvalidError("is closed and can't be used any more; create another", what)


def check(code: int, what: str = "", where: str = "") -> None:
    """Raises for functions that log nothing (the optics)."""
    if code != lib.PELL_OK:
        raise failure(code, what, where, "", called())


def fault_error(fault, code: int = lib.PELL_ERR_INVALID) -> Error:
    if not fault.field:
        return failure(code, "", "", "", called())
    return failure(code, f"is {fault.value:g}, must be in [{fault.min:g}, {fault.max:g}]", text(fault.field), "", called())


def version() -> str:
    """The version of the running library."""
    return text(lib.pell_version_string())


def named(said: str) -> str:
    """The options of the command line in a message of the library by the names of arguments: "--from" is from_."""
    return re.sub(r"(?<![\w-])--(?!limit\b)([a-z]+(?:-[a-z]+)*)", lambda m: {"from": "from_"}.get(m[1], m[1].replace("-", "_")), said)


def choose(kind: str, name: str, names: Iterable[str], owner: str = "") -> int:
    """The index of a name; InvalidError with the nearest one, or with all where none is near. `owner`: the argument that has such names."""
    known = list(names)
    if name in known:
        return known.index(name)
    near = difflib.get_close_matches(str(name), known, 1)
    said = f'has no {kind} "{name}"' if owner else f'there is no {kind} "{name}"'
    error = wrong(owner, said if near else f'{said}; there are {", ".join(known)}', f'did you mean "{near[0]}"?' if near else "")
    error.where = owner or kind
    raise error


def channel_number(channel: Any) -> int:
    """A channel: 0, 1 or 2."""
    if channel not in (0, 1, 2):
        raise wrong("channel", f"is {channel!r:.60}, must be 0, 1 or 2")
    return int(channel)


def bounded(value: Any, what: str, least: float, most: float) -> float:
    """A number in a range."""
    found = number(value, what)
    if not least <= found <= most:
        raise wrong(what, f"is {value!r:.60}, must be in [{least:g}, {most:g}]")
    return found


def whole(value: Any, what: str, least: int, most: int) -> int:
    """A whole number in a range."""
    found = bounded(value, what, least, most)
    if found != int(found):
        raise wrong(what, f"is {value!r:.60}, must be a whole number in [{least}, {most}]")
    return int(found)


def enum_names(count: int, at: Callable[[int], Any]) -> list[str]:
    return [text(at(i).name) for i in range(count)]


def numbers(values, what: str, dtype: Any = None) -> np.ndarray:
    """A contiguous array of a type (None: its own); the caller's own memory if it is one."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise wrong(what, f"has {np.ma.count_masked(values)} masked values, must have none", "remove or fill the masked values")
    try:
        array = np.asarray(values, dtype=dtype, order="C")
    except (TypeError, ValueError) as e:
        raise wrong(what, f"must be numbers: {e}") from None
    if array.dtype.kind not in "biuf":
        raise wrong(what, f"is {values!r:.60}, must be numbers")
    return array


def doubles(values, what: str) -> np.ndarray:
    """A contiguous array of doubles; the caller's own memory if it is one."""
    return numbers(values, what, np.float64)


def number(value, what: str) -> float:
    """One number."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise wrong(what, f"is {value!r:.60}, must be a number") from None


def pointer(array: np.ndarray, kind: str = "double *"):
    """The array's own memory."""
    return ffi.cast(kind, array.ctypes.data)


def three(value, what: str) -> np.ndarray:
    """Numbers of R, G and B from three or from one for all."""
    array = doubles(value, what)
    if array.shape not in ((), (1,), (3,)):
        raise wrong(what, f"has the shape {array.shape}, must be one number or three")
    return np.broadcast_to(array, (3,))


def set_fields(struct, values: dict, where: str) -> None:
    """Sets members of a C struct by name; InvalidError with the nearest name for an unknown one."""
    names = [name for name, _ in ffi.typeof(struct).fields] if ffi.typeof(struct).kind == "struct" else \
        [name for name, _ in ffi.typeof(struct).item.fields]
    for name, value in values.items():
        choose("member", name, names, where)
        try:
            setattr(struct, name, value.tolist() if isinstance(value, np.ndarray) else value)
        except (TypeError, ValueError, OverflowError, IndexError) as e:
            raise wrong(f"{where}.{name}", f"is {value!r:.60}, which does not fit: {e}") from None


_thread = threading.local()


def caller() -> int:
    """The thread that called: of a thread of Context.call the one that it works for."""
    return getattr(_thread, "caller", 0) or threading.get_ident()


@ffi.def_extern()
def _pellucid_log(user, message):
    ffi.from_handle(user)._message(message)


def _progress_failed(_type, error, _traceback):
    frame = _traceback.tb_frame.f_locals.get("user") if _traceback else None
    if frame:
        context = ffi.from_handle(frame)
        context.raise_later(error)
        lib.pell_context_cancel(context.c)
    return None


@ffi.def_extern(onerror=_progress_failed)
def _pellucid_progress(user, task, fraction):
    ffi.from_handle(user).progress(text(task), fraction)


class Single:
    """What owns memory of the library exists once."""

    def __reduce_ex__(self, _protocol):
        raise TypeError(f"{type(self).__name__} can't be copied or pickled: it owns memory of the library; create another")

    def __copy__(self):
        return self.__reduce_ex__(2)

    def __deepcopy__(self, _memo):
        return self.__reduce_ex__(2)


class Said:
    """What the library said during a call of one thread."""

    def __init__(self) -> None:
        self.errors: list[tuple[int, str, str, str]] = []
        self.warnings: list[str] = []
        self.raised: Optional[BaseException] = None


class Context(Single):
    """The library's log, limits and cancel flag. Warnings become Python's (PellucidWarning), facts go to the logger "pellucid".

    `progress(task, fraction)` is called while the library works, from the thread that works. An exception in it, or Ctrl-C, cancels the
    work and is raised to the caller; later calls run. After cancel() they fail: create another. `owner`: the class of the object that it
    belongs to and is closed with.
    """

    def __init__(self, progress: Optional[Progress] = None, owner: str = ""):
        self.progress, self.owner = progress, owner
        self._said: dict[int, Said] = {}  # by thread
        self._lock = threading.RLock()  # cancel() and the end
        self._process = os.getpid()
        self._handle = ffi.new_handle(self)
        out = ffi.new("struct pell_context **")
        self._out = out
        code = lib.pellpy_context(self._handle, lib.PELL_LOG_INFO, progress is not None, lib._pellucid_log, lib._pellucid_progress, out)
        self.check(code)

    @property
    def c(self):
        """The C struct pell_context."""
        if not self._out[0]:
            raise closed("Context")
        return self._out[0]

    def _of(self, thread: int) -> Said:
        return self._said.setdefault(thread, Said())

    def raise_later(self, error: BaseException) -> None:
        """Has check() of the calling thread raise it."""
        self._of(caller()).raised = error

    def _message(self, message) -> None:
        what = (text(message.where), named(text(message.what)), named(text(message.hint)))
        said = self._of(caller())
        if message.level == lib.PELL_LOG_ERROR:
            said.errors.append((message.code, *what))
        elif message.level == lib.PELL_LOG_WARNING:
            said.warnings.append(": ".join(filter(None, (named(what[0]), what[1]))) + (f" ({what[2]})" if what[2] else ""))
        else:
            _logger.info("%s", ": ".join(filter(None, what[:2])))

    def _take(self, failed: bool) -> Said:
        """What was said to the calling thread, after what was said in threads of the library: their errors are of a call that failed."""
        own = self._said.pop(caller(), None) or Said()
        if self._said:
            python = {t.ident for t in threading.enumerate()}
            for thread in [t for t in list(self._said) if t not in python]:
                other = self._said.pop(thread, None) or Said()
                own.warnings[:0] = other.warnings
                if failed:
                    own.errors[:0] = other.errors
                elif other.errors:
                    self._of(thread).errors[:0] = other.errors[-8:]
        return own

    def check(self, code: int) -> None:
        """Issues the warnings of the last call and raises if it failed."""
        said = self._take(code != lib.PELL_OK)
        if said.raised is not None:
            lib.pell_context_resume(self.c)
            raise said.raised
        for note in said.warnings:
            warnings.warn(note, PellucidWarning, stacklevel=outside())
        if code != lib.PELL_OK:
            _, where, what, hint = said.errors[-1] if said.errors else (code, "", "", "")
            given = not where or where.startswith("--") or where in ("method", "knobs") or what.startswith(f"{where} = ")
            raise failure(code, what, named(where), hint, called() if given else "")

    def call(self, function, *args) -> None:
        """Runs a function that returns a result. In the main thread Ctrl-C cancels it: KeyboardInterrupt is raised when it has ended."""
        if threading.current_thread() is not threading.main_thread():
            self.check(function(*args))
            return
        done, result, main = threading.Event(), [lib.PELL_OK], caller()

        def work():
            _thread.caller = main
            try:
                result[0] = function(*args)
            except BaseException as e:  # pylint: disable=broad-except # handed to the caller
                self.raise_later(e)
            finally:
                done.set()

        thread = threading.Thread(target=work, name="pellucid")
        thread.start()
        try:
            while not done.wait(0.1):  # a signal that another thread got is seen when this one wakes up
                pass
        except BaseException:
            lib.pell_context_cancel(self.c)
            thread.join()
            lib.pell_context_resume(self.c)
            self._take(True)
            raise
        thread.join()
        self.check(result[0])

    def cancel(self) -> None:
        """Ends running and later calls with CancelledError. From any thread."""
        with self._lock:
            lib.pell_context_cancel(self.c)

    def free(self) -> None:
        """close() for its owner."""
        if os.getpid() == self._process:
            with self._lock:
                lib.pell_context_destroy(self._out)
        self._out[0] = ffi.NULL

    def close(self) -> None:
        """Frees it. InvalidError if it belongs to an object that is still open, which closes it."""
        if self.owner and self._out[0]:
            raise InvalidError(f"belongs to a {self.owner}, which is still in use, and is closed with it", "Context",
                               f"close the {self.owner}")
        self.free()


class Turns:
    """Lets one call at a time use an object: calls of other threads wait. InvalidError: the call comes from a function that the object's
    own call runs (progress), or the object was made before a fork."""

    def __init__(self, what: str):
        self._what, self._lock, self._user, self._process = what, threading.Lock(), 0, os.getpid()
        self.threads = 0  # of the library, that the object uses

    @property
    def forked(self) -> bool:
        """It is the copy that a fork has made in another process, and the threads that it uses are not there."""
        return self.threads != 1 and os.getpid() != self._process

    def check(self) -> None:
        """InvalidError after a fork."""
        if self.forked:
            raise InvalidError("was made before this process was forked, and can't be used in it", self._what,
                               f'create the {self._what} in the child process, or start processes by multiprocessing\'s "spawn"')

    def __enter__(self) -> None:
        self.check()
        if self._user == caller():
            raise InvalidError("is at work in this thread: a function that it calls, such as progress, can't use it", self._what)
        self._lock.acquire()  # pylint: disable=consider-using-with # __exit__ releases it
        self._user = caller()

    def __exit__(self, *_exc) -> None:
        self._user = 0
        self._lock.release()


class Closing(Single):
    """A context manager for what owns memory of the library; close() may be called twice."""

    def close(self) -> None:
        raise NotImplementedError

    def __enter__(self):
        return self

    def __exit__(self, *_exc) -> None:
        self.close()

    def __del__(self):
        try:
            self.close()
        except (AttributeError, TypeError):  # not fully made, or at the interpreter's end
            pass


# --- Knobs ------------------------------------------------------------------------------------------------------------------------

_types = {lib.PELL_KNOB_BOOL: "bool *", lib.PELL_KNOB_INT: "int *", lib.PELL_KNOB_INT64: "int64_t *", lib.PELL_KNOB_FLOAT: "float *",
          lib.PELL_KNOB_ENUM: "int *"}


def knob_argument(knob: str) -> str:
    """The keyword argument that sets a knob."""
    word = knob.replace("-", "_")
    return word + "_" if word in ("as", "size") else word


def knob_rows(table) -> list:
    rows: list[Any] = []
    while table[len(rows)].type != lib.PELL_KNOB_NONE:
        rows.append(table[len(rows)])
    return rows


def knob_text(value, name: str) -> str:
    """A knob's value as the library's parser takes it: repr of a number keeps every bit."""
    if isinstance(value, (bool, np.bool_)):
        return "on" if value else "off"
    if isinstance(value, str):
        return value
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    try:
        return ",".join(repr(float(v)) for v in value)
    except (TypeError, ValueError):
        raise wrong(name, f"is {value!r:.60}, must be a number, a text, True, False, or a list of numbers") from None


def set_knobs(context: Context, table, owner: str, struct, values: dict[str, Any], where: str = "") -> None:
    known = [text(k.name).replace("-", "_") for k in knob_rows(table)]
    for name, value in values.items():
        choose("knob", name.replace("-", "_"), known)
        name = name.replace("_", "-")
        context.check(lib.pell_knob_set(context.c, table, owner.encode(), (where or name).encode(), struct, name.encode(),
                                        encoded(knob_text(value, name), name)))
