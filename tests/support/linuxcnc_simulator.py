"""LinuxCNC in simulation: a machine is set up in a folder, started without a screen, moved, and stopped, whatever happens.

`Setup` says which joints there are and what is added to the INI and HAL files; `run` moves the machine and returns the values of
HAL pins after each step. LinuxCNC and its modules are GPL and stay outside the library: they run as programs of their own
(`support/linuxcnc_ui.py` is the screen), and only files go between. One instance can run on a computer, so a lock is held.
Not LinuxCNC's own, /tmp/linuxcnc.lock: where that file exists, a new start takes it for a dead instance and ends what runs.
"""

import fcntl
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

PYTHON = "/usr/bin/python3"  # the interpreter of Debian's package
MODULES = "/usr/lib/linuxcnc/modules"  # the only place from which modules are loaded
PRIVATE = ("unshare", "--mount", "--propagation", "private")
NOBODY = 65534  # rtapi_app refuses to run as root without another user
LOCK = Path(tempfile.gettempdir()) / "volid-linuxcnc.lock"
SECONDS = 60  # a run that takes longer is stopped
OWN_LOCK = Path("/tmp/linuxcnc.lock")  # LinuxCNC's, there while it runs
PATIENCE = 90  # s that an instance of somebody else may take to end
PROGRAMS = ("milltask", "rtapi_app", "linuxcncsvr")
SCREEN = Path(__file__).with_name("linuxcnc_ui.py")


def why_not() -> str | None:
    """Why LinuxCNC cannot be run here, or None."""
    if shutil.which("linuxcnc") is None:
        return "LinuxCNC is not installed (Debian: apt-get install linuxcnc-uspace)"
    known = subprocess.run([PYTHON, "-c", "import hal, linuxcnc"], capture_output=True, check=False)
    return None if known.returncode == 0 else f"{PYTHON} does not have LinuxCNC's modules hal and linuxcnc"


def why_no_components() -> str | None:
    """Why components of HAL cannot be compiled and loaded here without installing them, or None."""
    if shutil.which("halcompile") is None or shutil.which("gcc") is None:
        return "no halcompile or gcc (Debian: apt-get install linuxcnc-uspace-dev gcc make)"
    tried = subprocess.run([*PRIVATE, "true"], capture_output=True, check=False)
    return None if tried.returncode == 0 else "a private view of LinuxCNC's modules needs root and `unshare --mount`"


needs_compiler = pytest.mark.skipif(why_no_components() is not None, reason=why_no_components() or "")
needs_linuxcnc = pytest.mark.skipif(why_not() is not None, reason=why_not() or "")


@dataclass(frozen=True)
class Joint:
    """One joint: axis letter, travel [mm or °], position after homing, further lines of its [JOINT_n] section, its limits."""

    letter: str
    low: float
    high: float
    home: float = 0.0
    lines: str = ""
    velocity: float = 5000.0
    acceleration: float = 100000.0

    @property
    def kind(self) -> str:
        """LINEAR or ANGULAR."""
        return "ANGULAR" if self.letter in "ABC" else "LINEAR"


@dataclass(frozen=True)
class Setup:
    """A simulated machine.

    Args:
        joints: In the order of their numbers; by default `drives` close the loop, motor position = motor command.
        files: Content by name of further files beside the INI file, such as compensation files.
        kinematics: What `loadrt` loads, with its arguments; by default trivkins with the letters of the joints.
        hal: HAL commands after the loops, such as a component between command and drive.
        drives: Whether the feedback of each joint is its motor command; False where `hal` closes the loops.
        units: "mm" or "inch".
        ini: Further sections of the INI file.
        components: Components to be compiled by `halcompile` for this run alone, `needs_compiler`.
    """

    joints: Sequence[Joint]
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    kinematics: str = ""
    hal: str = ""
    drives: bool = True
    units: str = "mm"
    ini: str = ""
    components: Sequence[Path] = ()

    @property
    def letters(self) -> str:
        """Axis letters of the joints, in their order."""
        return "".join(j.letter for j in self.joints)

    @property
    def loaded(self) -> str:
        """The kinematics, with its arguments."""
        return self.kinematics or f"trivkins coordinates={self.letters}"


@dataclass(frozen=True)
class Answer:
    """Pins after each step, what LinuxCNC said to the screen, what it printed, and the content of files asked for."""

    rows: list[list[float]]
    messages: list[str]
    printed: str
    files: Mapping[str, bytes]


class LinuxCNCError(Exception):
    """LinuxCNC did not start, or the task did not end well."""


def run(
    setup: Setup,
    steps: Sequence[Mapping],
    pins: Sequence[str],
    *,
    keep: Sequence[str] = (),
    seconds: float = SECONDS,
    stop_after: float | None = None,
) -> Answer:
    """The values of `pins` after each of the `steps` (see `linuxcnc_ui`).

    `keep`: files of its folder that are wanted afterwards. `seconds`: what the screen may take. `stop_after`: seconds after which
    everything is stopped, by default half a minute more. Raises `LinuxCNCError` where LinuxCNC does not start or a step fails;
    nothing keeps running afterwards.
    """
    # not pytest's folder: the real-time program runs as another user, who may not enter it
    with tempfile.TemporaryDirectory(prefix="volid-linuxcnc-") as place, alone():
        folder = Path(place)
        folder.chmod(0o755)
        write(setup, folder)
        task = {"steps": list(steps), "pins": list(pins), "seconds": seconds, "owner": os.getpid()}
        (folder / "task.json").write_text(json.dumps(task), encoding="utf-8")
        compile_components(setup.components, folder)
        printed = start(folder, seconds + 30 if stop_after is None else stop_after, bool(setup.components))
        return answered(folder, printed, keep)


def answered(folder: Path, printed: str, keep: Sequence[str]) -> Answer:
    """What the screen wrote down."""
    result = folder / "answer.json"
    if not result.exists():
        raise LinuxCNCError(f"LinuxCNC did not start its screen, or was stopped; it printed:\n{printed[-4000:]}")
    answer = json.loads(result.read_text(encoding="utf-8"))
    if answer["error"]:
        raise LinuxCNCError(f"{answer['error']}\n{answer['messages']}\n{printed[-4000:]}")
    return Answer(answer["rows"], answer["messages"], printed, {n: (folder / n).read_bytes() for n in keep})


@contextmanager
def alone() -> Iterator[None]:
    """One instance on this computer at a time; LinuxCNC's own lock file does not do: a second start ends the first instance.

    Raises `LinuxCNCError` where LinuxCNC runs that no test has started: it may move a real machine.
    """
    if not LOCK.exists():
        LOCK.touch()
    with open(LOCK, "rb") as lock:  # whoever made it: reading is enough
        fcntl.flock(lock, fcntl.LOCK_EX)
        end = time.monotonic() + PATIENCE
        while running():
            if time.monotonic() > end:
                raise LinuxCNCError(f"LinuxCNC already runs on this computer: {', '.join(running())}; end it first")
            time.sleep(0.5)
        with suppress(FileNotFoundError):
            if os.geteuid() not in (0, OWN_LOCK.stat().st_uid):
                raise LinuxCNCError(
                    f"{OWN_LOCK} is another user's, and no LinuxCNC runs that it could stand for; remove it first"
                )
        yield


def running() -> list[str]:
    """Programs of LinuxCNC that run on this computer."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            number, rest = (entry / "stat").read_text().split(" (", 1) if entry.name.isdigit() else ("", ") Z")
        except OSError:
            continue
        name, state = rest.rsplit(") ", 1)
        if name in PROGRAMS and not state.startswith("Z"):
            found.append(f"{name} ({number})")
    return found


def compile_components(components: Sequence[Path], folder: Path) -> None:
    """The modules of LinuxCNC and the compiled components, together in a folder of their own."""
    if components:
        shutil.copytree(MODULES, folder / "modules")
    for source in components:
        shutil.copy(source, folder)
        done = subprocess.run(["halcompile", "--compile", source.name], cwd=folder, capture_output=True, text=True)
        if done.returncode:
            raise LinuxCNCError(f"{source.name} does not compile:\n{done.stdout}{done.stderr}")
        shutil.copy(folder / f"{source.stem}.so", folder / "modules")


def start(folder: Path, seconds: float, own_modules: bool = False) -> str:
    """Runs LinuxCNC until its screen ends; what it printed. Stops everything after `seconds`.

    LinuxCNC loads modules from one folder alone; with `own_modules` it sees another one there, which nobody else sees.
    """
    command = ["linuxcnc", "-r", "machine.ini"]
    if own_modules:
        command = [*PRIVATE, "sh", "-c", f'mount --bind modules {MODULES} && exec "$@"', "sh", *command]
    with open(folder / "printed.txt", "wb") as out:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            with suppress(subprocess.TimeoutExpired):
                process.wait(seconds)
        finally:
            stop(process, folder)
    return (folder / "printed.txt").read_text(encoding="utf-8", errors="replace")


def environment(folder: Path) -> dict[str, str]:
    """Variables of LinuxCNC's own programs: nothing of the interpreter that runs the tests."""
    kept = {n: v for n, v in os.environ.items() if not n.startswith(("PYTHON", "VIRTUAL_ENV", "DISPLAY"))}
    pipes = folder / "pipes"
    pipes.mkdir(exist_ok=True)
    kept |= {"HOME": str(folder), "RTAPI_FIFO_PATH": str(pipes / "rtapi"), "PATH": "/usr/bin:/bin:/usr/sbin:/sbin"}
    if os.geteuid() == 0:
        kept["RTAPI_UID"] = str(NOBODY)
        pipes.chmod(0o777)
    return kept


def stop(process: subprocess.Popen, folder: Path) -> None:
    """Ends what this start of LinuxCNC left: its session's processes, and what has its folder as the working directory."""
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            process.wait(20)
    killed = left_over(process.pid, folder)
    for number in killed:
        with suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)
    process.wait(5)
    if killed:  # shared memory and LinuxCNC's own lock outlive a program that is killed
        subprocess.run(["halrun", "-U"], env=environment(folder), capture_output=True, check=False, timeout=20)
        OWN_LOCK.unlink(missing_ok=True)


def left_over(session: int, folder: Path) -> list[int]:
    """Processes of a session, or in the folder."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                here = os.getsid(int(entry.name)) == session or Path(os.readlink(entry / "cwd")) == folder.resolve()
            except OSError:
                continue
            if here and int(entry.name) != os.getpid():
                found.append(int(entry.name))
    return found


def write(setup: Setup, folder: Path) -> None:
    """The INI and HAL files, and those that are given."""
    shutil.copy(SCREEN, folder / "screen.py")
    (folder / "screen").write_text(f'#!/bin/sh\nexec {PYTHON} "$(dirname "$0")/screen.py"\n', encoding="utf-8")
    (folder / "screen").chmod(0o755)
    (folder / "machine.ini").write_text(ini(setup), encoding="utf-8")
    (folder / "machine.hal").write_text(hal(setup), encoding="utf-8")
    (folder / "tool.tbl").write_text("T1 P1 Z0 ;\n", encoding="utf-8")
    for name, content in setup.files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)


def ini(setup: Setup) -> str:
    """The INI file."""
    joints = "\n".join(_joint(n, j) for n, j in enumerate(setup.joints))
    return f"""[EMC]
VERSION = 1.1
MACHINE = simulated
DEBUG = 0
[DISPLAY]
DISPLAY = ./screen
[TASK]
TASK = milltask
CYCLE_TIME = 0.001
[RS274NGC]
PARAMETER_FILE = machine.var
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 4.0
SERVO_PERIOD = 1000000
[HAL]
HALFILE = machine.hal
[TRAJ]
COORDINATES = {" ".join(setup.letters)}
LINEAR_UNITS = {setup.units}
ANGULAR_UNITS = degree
MAX_LINEAR_VELOCITY = 5000
MAX_ANGULAR_VELOCITY = 5000
DEFAULT_LINEAR_VELOCITY = 2000
[KINS]
KINEMATICS = {setup.loaded}
JOINTS = {len(setup.joints)}
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.100
TOOL_TABLE = tool.tbl
{setup.ini}
{joints}
"""


def _joint(number: int, joint: Joint) -> str:
    limits = f"MIN_LIMIT = {joint.low}\nMAX_LIMIT = {joint.high}\n"
    limits += f"MAX_VELOCITY = {joint.velocity}\nMAX_ACCELERATION = {joint.acceleration}"
    return f"""[AXIS_{joint.letter}]
{limits}
[JOINT_{number}]
TYPE = {joint.kind}
{limits}
FERROR = 5
MIN_FERROR = 5
HOME = {joint.home}
HOME_OFFSET = {joint.home}
HOME_SEARCH_VEL = 0
HOME_LATCH_VEL = 0
HOME_SEQUENCE = 0
{joint.lines}"""


def hal(setup: Setup) -> str:
    """The HAL file."""
    loops = [f"net loop{n} joint.{n}.motor-pos-cmd => joint.{n}.motor-pos-fb" for n in range(len(setup.joints))]
    closed = "\n".join(loops) if setup.drives else ""
    return f"""loadrt {setup.loaded}
loadrt motmod servo_period_nsec=1000000 num_joints={len(setup.joints)}
addf motion-command-handler servo-thread
addf motion-controller servo-thread
{closed}
net estop iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in
net change iocontrol.0.tool-change => iocontrol.0.tool-changed
net prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared
{setup.hal}
"""
