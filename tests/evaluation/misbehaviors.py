"""A policy that misbehaves as it is ordered to: a table of misbehaviors, and a policy that does one at a moment.

A test copies this file into a folder of its own, writes ``orders.json`` beside it, and names the copy as a policy.
"""

# ruff: noqa: ARG005, N818, PLE0304, PTH106, PTH208, S605, S606, S607, T201, TID251
from __future__ import annotations

import ast
import asyncio
import atexit
import builtins
import ctypes
import fcntl
import gc
import json
import locale
import multiprocessing
import os
import pickle
import random
import resource
import shutil
import signal
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path

import numpy as np

from betterbench.errors import InvalidInputError, UnknownNameError
from betterbench.interface import Execution, PolicyInfo

HERE = Path(__file__).absolute()
MOMENTS = ("import", "init", "reset", "act", "close")
NOTHING = object()
DO = {}
"""What a policy may do, by name; what is returned stands for its answer."""
WHEN = {}
"""At which moments each makes sense."""


def does(*moments):
    def named(function):
        DO[function.__name__] = function
        WHEN[function.__name__] = moments or MOMENTS
        return function

    return named


def raises(name, problem, *moments):
    def function(_):
        raise problem()

    function.__name__ = name
    does(*moments)(function)


def answers(name, value):
    def function(policy):
        return value(policy)

    function.__name__ = f"answers_{name}"
    does("act")(function)


def run_folder():
    return Path(ORDERS["run"])


def descriptors():
    found = [int(name) for name in os.listdir("/proc/self/fd")]
    return [number for number in found if Path(f"/proc/self/fd/{number}").is_symlink()]


# ------------------------------------------------------------------------------------------------ the process's state


@does()
def changes_directory(_):
    os.chdir("/")


@does()
def removes_its_directory(_):
    folder = tempfile.mkdtemp()
    os.chdir(folder)
    os.rmdir(folder)


@does()
def clears_environment(_):
    os.environ.clear()


@does()
def poisons_environment(_):
    for name in ("PYTHONPATH", "HOME", "TMPDIR", "LD_PRELOAD", "PYTHONHOME", "BETTERBENCH_LOG_LEVEL", "MUJOCO_GL"):
        os.environ[name] = "/nowhere\udcff"


@does()
def seeds_everything(_):
    random.seed(0)
    np.random.seed(0)  # noqa: NPY002
    np.seterr(all="raise")


@does()
def changes_umask(_):
    os.umask(0o777)


@does()
def changes_locale(_):
    for name in locale.locale_alias.values():
        try:
            locale.setlocale(locale.LC_ALL, name)
        except locale.Error:
            continue
        if locale.localeconv()["decimal_point"] == ",":
            break


@does()
def lowers_priority(_):
    os.nice(19)
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


@does()
def clears_path_and_modules(_):
    sys.path.clear()
    sys.argv.clear()
    sys.modules.clear()


@does()
def lowers_recursion_limit(_):
    sys.setrecursionlimit(60)


@does()
def traces_and_raises(_):
    def tracer(*_):
        raise RuntimeError("traced")

    threading.settrace(tracer)
    sys.settrace(tracer)


@does()
def breaks_hooks(_):
    sys.excepthook = sys.unraisablehook = threading.excepthook = None
    sys.displayhook = sys.breakpointhook = 3


@does()
def makes_warnings_errors(_):
    warnings.simplefilter("error")
    warnings.warn("a warning", stacklevel=1)


@does()
def turns_garbage_collection_off(_):
    gc.disable()
    gc.set_threshold(0)
    gc.freeze()


@does()
def registers_exits(_):
    atexit.register(time.sleep, 60)
    atexit.register(os._exit, 9)
    atexit.register(lambda: 1 / 0)


@does()
def leaves_things_that_fail_when_deleted(_):
    class Evil:
        def __del__(self):
            raise RuntimeError("deleted")

    class Leaving:
        def __del__(self):
            os._exit(5)

    Evil()
    sys.evil = Evil(), Leaving()


# --------------------------------------------------------------------------------------------------------- signals


@does()
def ignores_signals(_):
    for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP, signal.SIGCHLD}:
        try:
            signal.signal(number, signal.SIG_IGN)
        except (OSError, ValueError):
            continue


@does()
def blocks_signals(_):
    signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())


@does("act")
def is_interrupted_again_and_again(_):
    def raise_it(*_):
        raise KeyboardInterrupt

    signal.signal(signal.SIGALRM, raise_it)
    signal.setitimer(signal.ITIMER_REAL, 0.001, 0.001)
    while True:
        pass


@does("init", "reset", "act")
def sets_an_alarm(_):
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    time.sleep(20)


for _name in ("SIGTERM", "SIGINT", "SIGHUP", "SIGSEGV", "SIGABRT", "SIGPIPE", "SIGUSR1", "SIGKILL", "SIGSTOP"):

    def _send(_, name=_name):
        number = getattr(signal, name)
        if number not in (signal.SIGKILL, signal.SIGSTOP):
            signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    _send.__name__ = f"sends_itself_{_name}"
    does("reset", "act")(_send) if _name in ("SIGSTOP", "SIGKILL") else does()(_send)


@does()
def kills_its_group(_):
    os.killpg(0, signal.SIGKILL)


@does()
def reads_address_zero(_):
    ctypes.string_at(0)


# ------------------------------------------------------------------------------------------------- files and outputs


@does()
def closes_standard_files(_):
    for number in (0, 1, 2):
        os.close(number)


@does()
def closes_all_files(_):
    os.closerange(0, 4096)


@does()
def puts_null_over_all_files(_):
    null = os.open(os.devnull, os.O_RDWR)
    for number in descriptors():
        if number != null:
            os.dup2(null, number)


@does()
def writes_garbage_to_all_files(_):
    for number in descriptors():
        try:
            os.write(number, bytes(range(256)) * 4)
        except OSError:
            continue


@does()
def writes_garbage_to_outputs(_):
    os.write(1, b"\xff\xfe\x00\x1b[2J\x1b]0;pwned\x07" * 1000)
    os.write(2, b"\x1b[31m\x9b\xe2\x80\xae no line end")


@does()
def floods_its_outputs(_):
    for _ in range(40):
        print("x" * 100_000, file=sys.stderr)


@does()
def makes_all_files_nonblocking(_):
    for number in descriptors():
        try:
            fcntl.fcntl(number, fcntl.F_SETFL, os.O_NONBLOCK)
        except OSError:
            continue


@does()
def cuts_and_rewinds_all_files(_):
    for number in descriptors():
        try:
            os.ftruncate(number, 0)
            os.lseek(number, 0, os.SEEK_SET)
        except OSError:
            continue


@does()
def opens_files_without_end(policy):
    kept = []
    try:
        while len(kept) < 5000:
            kept.append(os.open(os.devnull, os.O_RDONLY))
    finally:
        sys.kept = kept


@does()
def loses_its_streams(_):
    sys.stdin = sys.stdout = sys.stderr = sys.__stdout__ = sys.__stderr__ = None


@does()
def closes_its_streams(_):
    sys.stdout.close()
    sys.stderr.close()


@does()
def asks_for_input(_):
    sys.stdin.read()
    input("password: ")


def sockets():
    return [number for number in descriptors() if stat.S_ISSOCK(os.fstat(number).st_mode)]


@does("act")
def shuts_its_socket(_):
    for number in sockets():
        socket.socket(fileno=os.dup(number)).shutdown(socket.SHUT_RDWR)


@does("import", "init", "act")
def sends_half_a_frame(_):
    for number in sockets():
        os.write(number, b"\0\0\0")
    time.sleep(0.3)
    os._exit(1)


@does("import", "init", "act")
def sends_a_frame_without_end(_):
    for number in sockets():
        os.write(number, struct.pack(">IIQQ", 0, 0, 1 << 60, 1) + b"x" * 1000)


@does("import", "init", "act")
def sends_a_pickle(_):
    class Bomb:
        def __reduce__(self):
            return os._exit, (7,)

    data = pickle.dumps(("ok", Bomb()))
    for number in sockets():
        os.write(number, struct.pack(">Q", len(data)) + data)
        os.write(number, struct.pack(">i", len(data)) + data)


def resend(change):
    ordinary = socket.socket.sendall

    def changed(self, data, *rest):
        for part in change(bytes(data)):
            ordinary(self, part, *rest)

    socket.socket.sendall = changed


@does()
def answers_twice(_):
    resend(lambda data: [data, data])


@does("act")
def sends_its_answers_in_bits(_):
    resend(lambda data: [data[i : i + 7] for i in range(0, len(data), 7)])


@does("act")
def answers_for_tomorrow(_):
    resend(lambda data: [data[:16] + struct.pack(">Q", 999) + data[24:]])


@does("act")
def answers_arrays_too_many(_):
    resend(lambda data: [data.replace(b'{"0": [', b'{"9": ["<f8", [999999999, 9]], "0": [')])


@does("act")
def reads_the_questions_itself(_):
    def read():
        for number in sockets():
            os.read(number, 1 << 20)

    threading.Thread(target=read, daemon=True).start()


# ------------------------------------------------------------------------------------------------ threads and processes


@does()
def leaves_threads(_):
    for _ in range(20):
        threading.Thread(target=time.sleep, args=(3600,)).start()


@does()
def leaves_a_busy_thread(_):
    def spin():
        while True:
            pass

    threading.Thread(target=spin, daemon=True).start()


@does()
def leaves_a_thread_that_fails(_):
    threading.Thread(target=lambda: 1 / 0).start()


@does("act")
def hangs(_):
    time.sleep(3600)


@does("act")
def spins(_):
    while True:
        pass


@does("act")
def waits_for_itself(_):
    lock = threading.Lock()
    lock.acquire()
    lock.acquire()


@does("act")
def answers_late(_):
    time.sleep(4.0)


@does("import")
def hangs_while_it_is_imported(_):
    time.sleep(3600)


@does()
def leaves_a_child(_):
    if not os.fork():
        time.sleep(3600)
        os._exit(0)


@does()
def leaves_a_child_that_holds_everything_open_and_ends(_):
    if not os.fork():
        time.sleep(3600)
        os._exit(0)
    os._exit(6)


@does()
def leaves_a_daemon(_):
    if not os.fork():
        os.setsid()
        if not os.fork():
            time.sleep(3600)
        os._exit(0)
    os.wait()


@does()
def leaves_a_program(_):
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"], start_new_session=True)


@does()
def leaves_a_worker(_):
    multiprocessing.get_context("fork").Process(target=time.sleep, args=(3600,)).start()


@does()
def forks_and_goes_on_twice(_):
    os.fork()


@does("act")
def becomes_another_program(_):
    os.execv("/bin/sh", ["sh", "-c", "exit 8"])


@does("act")
def becomes_a_program_that_hangs(_):
    os.execv("/bin/sleep", ["sleep", "3600"])


@does()
def runs_a_shell(_):
    os.system("echo from a shell; kill -9 0 & exit 3")


# --------------------------------------------------------------------------------------------- ends and exceptions


@does()
def exits_with_0(_):
    os._exit(0)


@does()
def exits_with_3(_):
    os._exit(3)


class Unspeakable(Exception):
    def __str__(self):
        raise RuntimeError("no words")

    __repr__ = __str__


class EvilText(str):
    __slots__ = ()

    def __str__(self):
        return self

    def __reduce__(self):
        return os._exit, (11,)

    def encode(self, *_):
        return self

    def decode(self, *_):
        return self


class Meta(type):
    @property
    def __name__(cls):
        raise RuntimeError("nameless")


class Nameless(Exception, metaclass=Meta):
    pass


class Pickled(Exception):
    def __reduce__(self):
        return os._exit, (12,)


def chained():
    problem = RuntimeError("chained")
    problem.__cause__ = problem
    return problem


raises("exits_by_sys", lambda: SystemExit(0))
raises("exits_by_sys_with_text", lambda: SystemExit("bye \x1b[2J"))
raises("raises_base_exception", lambda: BaseException("base"))
raises("is_cancelled", lambda: asyncio.CancelledError("now"))
raises("ends_a_generator", GeneratorExit)
raises("is_interrupted", KeyboardInterrupt)
raises("stops_an_iteration", StopIteration)
raises("stops_an_async_iteration", StopAsyncIteration)
raises("raises_a_group", lambda: BaseExceptionGroup("several", [KeyboardInterrupt(), ValueError("x")]))
raises("runs_out_of_memory", MemoryError)
raises("raises_what_has_no_words", Unspeakable)
raises("raises_what_has_no_name", Nameless)
raises("raises_a_long_text", lambda: RuntimeError("x" * 10_000_000 + "\n\x1b[31m"))
raises("raises_an_evil_text", lambda: RuntimeError(EvilText("evil")))
raises("raises_an_evil_name", lambda: UnknownNameError(EvilText("kind"), "name", [EvilText("x")]))
raises("raises_an_evil_input", lambda: InvalidInputError(EvilText("a"), EvilText("b"), EvilText("c")))
raises("raises_what_runs_when_read", Pickled)
raises("raises_itself_as_cause", chained)
raises("raises_half_a_character", lambda: RuntimeError("\ud800 \x00"))
raises("raises_a_warning", lambda: UserWarning("warned"))
raises("raises_a_broken_pipe", BrokenPipeError, "reset", "act", "close")
raises("raises_an_end_of_file", EOFError, "reset", "act", "close")
raises("raises_a_timeout", TimeoutError, "reset", "act", "close")


@does()
def recurses(_):
    recurses(_)


@does()
def overflows_its_stack(_):
    sys.setrecursionlimit(10**9)
    threading.stack_size(1 << 16)
    sys.setrecursionlimit(10**7)

    class Deep:
        def __getattr__(self, name):
            return getattr(self, name + "x")

    repr(Deep().x)


@does()
def runs_a_loop(_):
    asyncio.run(asyncio.sleep(0))
    asyncio.new_event_loop()


# ------------------------------------------------------------------------------------------------------------ limits


def limits(name, kind, soft, *then):
    def function(policy):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (soft, hard))
        for act in then:
            act(policy)

    function.__name__ = f"limits_{name}"
    does()(function)


limits("files", resource.RLIMIT_NOFILE, 3)
limits("file_size", resource.RLIMIT_FSIZE, 0)
limits("memory", resource.RLIMIT_AS, 400 << 20, lambda _: bytearray(1 << 30))
limits("processes", resource.RLIMIT_NPROC, 0)
limits("stack", resource.RLIMIT_STACK, 8192)
limits("core", resource.RLIMIT_CORE, 0)


@does("act")
def limits_its_time(_):
    resource.setrlimit(resource.RLIMIT_CPU, (1, 1))
    while True:
        pass


@does()
def keeps_memory(_):
    sys.hoard = bytearray(150 << 20)


# ------------------------------------------------------------------------------------------------------------- files


@does()
def deletes_its_file(_):
    HERE.unlink(missing_ok=True)


@does()
def rewrites_its_file(_):
    HERE.write_text("raise SystemExit(3)")


@does()
def turns_its_file_into_a_folder(_):
    HERE.unlink(missing_ok=True)
    HERE.mkdir(exist_ok=True)


def on_run(name, act):
    def function(_):
        if run_folder().exists():
            act(run_folder())

    function.__name__ = f"{name}_of_the_run"
    does("reset", "act", "close")(function)


def _cut(path, size):
    if path.exists():
        os.truncate(path, size)


def _append(path, data):
    if path.exists():
        with path.open("ab") as stream:
            stream.write(data)


def _rename(path, name):
    if path.exists():
        path.rename(path.with_name(name))


def _flip(run):
    for path in sorted((run / "records").rglob("*.parquet")):
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 255
        path.write_bytes(data)


def _link(run):
    journal = run / "journal.jsonl"
    if journal.exists():
        journal.rename(run.parent / f"moved-{run.name}")
        journal.symlink_to("nowhere")


def _replace(run):
    (run / "journal.jsonl").unlink(missing_ok=True)
    (run / "journal.jsonl").write_text("{}\n")


def _litter(run):
    for number in range(50):
        (run / f"junk-{number}").write_text("junk")
    (run / "records").mkdir(exist_ok=True)
    (run / "records" / ".x.parquet.y.part").write_text("half")


on_run("deletes_the_journal", lambda run: (run / "journal.jsonl").unlink(missing_ok=True))
on_run("renames_the_journal", lambda run: _rename(run / "journal.jsonl", "elsewhere"))
on_run("cuts_the_journal", lambda run: _cut(run / "journal.jsonl", 10))
on_run("empties_the_journal", lambda run: _cut(run / "journal.jsonl", 0))
on_run("appends_to_the_journal", lambda run: _append(run / "journal.jsonl", b'{"garbage": 1}\nand more'))
on_run("replaces_the_journal", _replace)
on_run("links_the_journal", _link)
on_run("deletes_the_description", lambda run: (run / "run.json").unlink(missing_ok=True))
on_run("renames_the_description", lambda run: _rename(run / "run.json", "run.jsonx"))
on_run("corrupts_the_description", lambda run: (run / "run.json").write_text("{"))
on_run("changes_the_description", lambda run: (run / "run.json").write_text('{"schema_version": 1}'))
on_run("deletes_the_records", lambda run: shutil.rmtree(run / "records", ignore_errors=True))
on_run("renames_the_records", lambda run: _rename(run / "records", "notes"))
on_run("damages_the_records", _flip)
on_run("deletes_the_scenes", lambda run: shutil.rmtree(run / "scenes", ignore_errors=True))
on_run("deletes_the_lock", lambda run: (run / ".lock").unlink(missing_ok=True))
on_run("litters_the_folder", _litter)
on_run("deletes_all", lambda run: shutil.rmtree(run, ignore_errors=True))
on_run("renames_all", lambda run: run.rename(run.with_name(f"{run.name}-gone-{time.time_ns()}")))
on_run("forbids_all", lambda run: run.chmod(0))


# ----------------------------------------------------------------------------------------------------- monkeypatching


def patches(name, *places):
    def function(_):
        for owner, attribute, value in places:
            setattr(owner, attribute, value)

    function.__name__ = f"patches_{name}"
    does()(function)


def fails(*_, **__):
    raise RuntimeError("patched")


patches("open", (builtins, "open", None), (os, "open", fails))
patches("len", (builtins, "len", lambda _: 0))
patches("isinstance", (builtins, "isinstance", lambda *_: True))
patches("import", (builtins, "__import__", fails))
patches("getattr", (builtins, "getattr", fails), (builtins, "type", fails))
patches("str", (builtins, "str", fails), (builtins, "tuple", fails), (builtins, "list", fails))
patches("exceptions", (builtins, "Exception", int), (builtins, "BaseException", int), (builtins, "OSError", int))
patches("print", (builtins, "print", fails))
patches("numpy_arrays", (np, "array", fails), (np, "asarray", fails), (np, "frombuffer", fails), (np, "ndarray", int))
patches("numpy_silently", (np, "asarray", lambda x, *_: np.zeros(7)), (np, "array", lambda *_, **__: np.zeros(7)))
patches("numpy_dtypes", (np, "dtype", fails), (np, "float64", int))
patches("json", (json, "dumps", fails), (json, "loads", fails), (json.JSONEncoder, "encode", fails))
patches("json_silently", (json, "dumps", lambda *_, **__: "{}"), (json.JSONEncoder, "iterencode", lambda *_: ["{}"]))
patches("pickle", (pickle, "dumps", fails), (pickle, "loads", fails), (pickle, "Unpickler", None))
patches("struct", (struct, "pack", fails), (struct, "unpack", fails), (struct, "Struct", None))
patches("sockets", (socket.socket, "sendall", fails))
patches("receiving", (socket.socket, "recv", fails), (socket.socket, "recv_into", fails))
patches("exits", (os, "_exit", lambda *_: None), (sys, "exit", lambda *_: None))
patches("system_calls", (os, "write", fails), (os, "read", fails), (os, "close", fails), (os, "kill", fails))
patches("time", (time, "monotonic", lambda: 0.0), (time, "time", lambda: -1.0), (time, "sleep", lambda _: None))
patches("threads", (threading, "Thread", None), (threading, "Lock", None), (threading, "current_thread", fails))
patches("pathlib", (Path, "exists", fails), (Path, "__init__", fails))


@does()
def patches_betterbench(_):
    import betterbench.errors
    import betterbench.interface

    betterbench.errors.BetterError = betterbench.errors.PolicyError = int
    betterbench.interface.PolicyInfo = betterbench.interface.BatchPolicy = None
    for name, module in list(sys.modules.items()):
        if name.startswith("betterbench.policies"):
            for attribute in ("_answered", "_told", "send_frame", "content_of", "load_plugin", "text_of", "_close"):
                if hasattr(module, attribute):
                    setattr(module, attribute, fails)


@does("act")
def patches_its_own_class(policy):
    type(policy).__getattribute__ = fails


@does("act")
def empties_itself(policy):
    policy.__dict__.clear()


# ------------------------------------------------------------------------------------------------------------ answers


class EvilArray(np.ndarray):
    def __array_finalize__(self, _):
        pass

    def tobytes(self, *_):
        raise SystemExit("tobytes")

    @property
    def shape(self):
        raise KeyboardInterrupt

    @property
    def dtype(self):
        return EvilText("|O")

    def __reduce__(self):
        return os._exit, (13,)

    def __array_ufunc__(self, *_, **__):
        os._exit(14)


class EvilFloat(float):
    def __float__(self):
        os._exit(15)

    def __reduce__(self):
        return os._exit, (16,)


class Converts:
    def __init__(self, value):
        self.value = value

    def __array__(self, *_, **__):
        return self.value() if callable(self.value) else self.value


class Lies(list):
    def __len__(self):
        return 10**12

    def __iter__(self):
        while True:
            yield 0.0


class Interface:
    __array_interface__ = {"shape": (1 << 40,), "typestr": "<f8", "data": (64, False), "version": 3}  # noqa: RUF012


class Reduces:
    def __reduce__(self):
        return os._exit, (17,)


def endless():
    form = []
    form.append(form)
    return form


def mapped(_):
    place = tempfile.mktemp()  # noqa: S306
    array = np.memmap(place, float, "w+", shape=(1, 7))
    os.truncate(place, 0)
    return array


VALID = np.array([[0.25, -0.5, 0.125, 0.0, 0.5, -0.25, -1.0]])

for _name, _value in {
    "none": lambda _: None,
    "an_empty_list": lambda _: [],
    "an_empty_chunk": lambda _: np.zeros((0, 7)),
    "a_text": lambda _: "forward",
    "bytes": lambda _: b"\0" * 56,
    "a_map": lambda _: {"actions": [0.0] * 7},
    "a_set": lambda _: {1.0, 2.0},
    "an_object": lambda _: object(),
    "objects_that_run_when_read": lambda _: [Reduces()] * 7,
    "nan": lambda _: VALID * np.nan,
    "infinity": lambda _: VALID / 0.0 if np.geterr()["divide"] != "raise" else VALID * np.inf,
    "huge_numbers": lambda _: VALID * 1e308,
    "a_huge_integer": lambda _: [10**400] * 7,
    "truths": lambda _: VALID > 0,
    "complex_numbers": lambda _: VALID.astype(complex),
    "texts": lambda _: VALID.astype("U9"),
    "numbers_as_objects": lambda _: VALID.astype(object),
    "a_ragged_list": lambda _: [[0.0] * 7, [0.0] * 6],
    "float16": lambda _: VALID.astype(np.float16),
    "integers": lambda _: VALID.astype(np.int8),
    "big_endian": lambda _: VALID.astype(">f8"),
    "fortran_order": lambda _: np.asfortranarray(np.repeat(VALID, 3, axis=0)),
    "negative_strides": lambda _: np.repeat(VALID, 3, axis=0)[::-1],
    "a_masked_array": lambda _: np.ma.masked_array(VALID, mask=VALID > 0),
    "a_matrix": lambda _: np.asmatrix(VALID),
    "an_evil_array": lambda _: VALID.view(EvilArray),
    "evil_numbers": lambda _: [EvilFloat(0.5)] * 7,
    "what_fails_to_convert": lambda _: Converts(lambda: 1 / 0),
    "what_converts_to_itself": lambda _: Converts(3),
    "what_converts_to_evil": lambda _: Converts(VALID.view(EvilArray)),
    "an_array_that_is_not_there": lambda _: Interface(),
    "a_list_that_lies": lambda _: Lies([0.0] * 7),
    "a_file_that_is_gone": mapped,
    "itself": lambda _: endless(),
    "a_generator": lambda _: (x for x in [0.0] * 7),
    "a_number": lambda _: 0.5,
    "four_axes": lambda _: VALID[None, None],
    "too_few": lambda _: VALID[:, :6],
    "too_many": lambda _: np.ones((1, 8)),
    "dates": lambda _: np.zeros(7, "datetime64[s]"),
    "fields": lambda _: np.zeros(7, [("x", float), ("y", object)]),
    "80_megabytes": lambda _: np.zeros((1 << 21, 7)),
    "a_class": lambda _: np.float64,
    "itself_as_policy": lambda policy: policy,
    "not_implemented": lambda _: NotImplemented,
    "a_coroutine": lambda _: ast,
}.items():
    answers(_name, _value)


# ------------------------------------------------------------------------------------------------ what it declares


def declares(name, change):
    def function(policy):
        policy.info = change()

    function.__name__ = f"declares_{name}"
    does("init")(function)


class EvilInfo(PolicyInfo):
    @property
    def execution(self):
        raise KeyboardInterrupt("execution")

    def __reduce__(self):
        return os._exit, (18,)


class EvilTruth:
    def __bool__(self):
        os._exit(19)


declares("a_long_name", lambda: PolicyInfo("x" * 3_000_000, needs_images=False))
declares("an_evil_name", lambda: PolicyInfo(EvilText("misbehaving"), needs_images=False))
declares("a_name_that_steers", lambda: PolicyInfo("\x1b[2J\n\u202e\ud800", needs_images=False))
declares("much", lambda: PolicyInfo("m", needs_images=False, metadata={str(i): "y" * 1000 for i in range(20_000)}))
declares("evil_texts", lambda: PolicyInfo("m", needs_images=False, metadata={EvilText("a"): EvilText("b")}))
declares("an_evil_truth", lambda: PolicyInfo("m", needs_images=EvilTruth()))
declares("a_fraction_of_a_step", lambda: PolicyInfo("m", needs_images=False, execution=Execution(horizon=1.5)))
declares("an_evil_info", lambda: EvilInfo("m", needs_images=False))
declares("nothing", lambda: None)
declares("another_space", lambda: PolicyInfo("m", "joint_position", needs_images=False))


@does("init")
def has_every_attribute(policy):
    type(policy).__getattr__ = lambda self, name: print


@does("init")
def says_it_is_another_class(policy):
    policy.act = 3


@does("close")
def closes_slowly(_):
    time.sleep(60)


@does("close")
def closes_with_an_exit(_):
    os._exit(7)


# ------------------------------------------------------------------------------------------------------------- policy


_orders = HERE.with_name("orders.json")
ORDERS = json.loads(_orders.read_text()) if _orders.exists() else {}


class Misbehaving:
    """Acts well, but for the moment of its orders; all its actions follow from episode and step."""

    info = PolicyInfo("misbehaving", needs_images=False)

    def __init__(self):
        self.episode = -1
        self.do("init")

    def reset(self, start):
        self.episode = start.episode
        self.do("reset")

    def act(self, observation):
        if observation.step == 3:
            given = self.do("act")
            if given is not NOTHING:
                return given
        x = ((self.episode >> observation.step) % 7 - 3) / 10
        return [x, -x, x / 2, 0.0, x, 0.0, -1.0]

    def close(self):
        self.do("close")

    def do(self, moment):
        given = NOTHING
        if ORDERS.get("moment") == moment and (moment in ("init", "close") or self.episode == ORDERS["episode"]):
            for name in ORDERS["what"]:
                result = DO[name](self)
                if name.startswith("answers_") and moment == "act":
                    given = result
        return given


if ORDERS.get("moment") == "import":
    for _what in ORDERS["what"]:
        DO[_what](None)
