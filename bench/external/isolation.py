"""`--isolate`: runs a program in namespaces in which only the system, its own files and its job folder are visible.

They are created by bubblewrap, or else by `unshare` of util-linux; where neither works, the run is refused. The program
has its own process, mount, user, host name and IPC namespaces, and no network. Read-only are the system's programs and
libraries, the Python installation that the command uses, and the files that its table names. Writable are its working
directory `/job` and `/tmp`.
"""

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path

from uavbench.trajectories.errors import UserError

SYSTEM = ("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32", "/nix/store", "/gnu/store")
ETC = ("alternatives", "fonts", "ld.so.cache", "ld.so.conf", "ld.so.conf.d", "localtime", "nsswitch.conf")
PREFIX = ("bin", "conda-meta", "etc", "include", "lib", "lib32", "lib64", "libexec", "pyvenv.cfg", "share", "ssl")
"""Visible subfolders of a Python installation, virtual environment or conda prefix."""
KERNEL = ("sys", "sysrq-trigger", "irq", "bus")
"""Machine-wide entries of /proc, mounted read-only because root can write them even without capabilities."""
SHARED_MEMORY_MB = 256
THREADS = ("OMP_NUM_THREADS",)
"""Variables of threads: another number of them may add in another order."""
PASSED_IN = ("PATH", *THREADS)
"""The only environment variables passed to the program."""
EVERYWHERE = {"LC_ALL": "C.UTF-8", "PYTHONUNBUFFERED": "1"}
"""Environment variables with the same value in each run: a program's numbers do not follow the locale of its user."""
WITHIN = {"HOME": "/tmp", "TMPDIR": "/tmp", "USER": "tracker", **EVERYWHERE}
PROBE_S = 30.0

Way = Callable[[Sequence[str], Path, Sequence[Path]], list[str]]
"""Builds the isolating command from a command, its job folder and the visible paths."""


def isolated(command: Sequence[str], folder: Path, files: Iterable[Path]) -> list[str]:
    """Command line that runs `command` isolated, with its job folder and read-only files; UserError if unsupported."""
    way, program = usable(), unwrapped(command[0])
    return way([program, *command[1:]], folder, visible(program, files))


@cache
def unwrapped(program: str) -> str:
    """Path of the Python interpreter behind a shim on PATH, such as pyenv's."""
    at = shutil.which(program)
    if at is None or not Path(program).name.startswith("python") or Path(at).read_bytes()[:2] != b"#!":
        return program
    asked = [at, "-I", "-c", "import sys; print(sys.executable)"]
    try:
        return subprocess.run(asked, capture_output=True, text=True, timeout=PROBE_S, check=True).stdout.strip()
    except (subprocess.SubprocessError, OSError):
        return program


def visible(program: str, files: Iterable[Path] = ()) -> list[Path]:
    """Paths that are visible read-only besides the job folder; none contains another."""
    found = [*map(Path, SYSTEM), *(Path("/etc", name) for name in ETC), *_prefixes(program), *files]
    if (at := shutil.which(program)) is not None:
        found.append(Path(at).absolute())
    kept: list[Path] = []
    for path in sorted({path for path in found if path.exists()}, key=lambda path: len(path.parts)):
        if not any(path.is_relative_to(outer) for outer in kept):
            kept.append(path)
    return kept


def refuse_seen(program: str, files: Iterable[Path], hidden: Path) -> None:
    """Raise UserError when a folder that must stay hidden would be visible to an isolated program, even in part."""
    hidden = hidden.resolve()
    for path in visible(unwrapped(program), files):
        if hidden.is_relative_to(path.resolve()) or path.resolve().is_relative_to(hidden):
            raise UserError(
                f"isolate: {path} would be visible, and with it the ground truth of {hidden}; move one of the two"
            )


@cache
def usable() -> Way:
    """The tool that can create namespaces on this machine; UserError with the message of each that fails."""
    why = []
    ways: dict[str, Way] = {"bwrap": _bubblewrap, "unshare": _unshare}
    for name, way in ways.items():
        if shutil.which(name) is None:
            why.append(f"{name} is not installed")
            continue
        with tempfile.TemporaryDirectory(prefix="uavbench-probe-") as scratch:
            (Path(scratch) / "tmp").mkdir()
            command = way(["true"], Path(scratch), visible("true"))
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=PROBE_S, check=False)
            except subprocess.TimeoutExpired:
                why.append(f"{name} hangs")
                continue
        if done.returncode == 0:
            return way
        words = done.stderr.strip().splitlines()
        why.append(f"{name}: {words[-1] if words else f'exit code {done.returncode}'}")
    raise UserError(
        f"isolate: programs cannot be isolated on this machine ({'; '.join(why)}); install bubblewrap, enable user "
        "namespaces, or run programs that you trust without --isolate"
    )


def _bubblewrap(command: Sequence[str], folder: Path, paths: Sequence[Path]) -> list[str]:
    out = ["bwrap", "--unshare-all", "--die-with-parent", "--cap-drop", "ALL", "--hostname", "tracker"]
    out += ["--bind", str(folder), "/job", "--bind", str(folder / "tmp"), "/tmp", "--proc", "/proc"]
    for name in KERNEL:
        out += ["--ro-bind-try", *[f"/proc/{name}"] * 2]
    out += ["--dev", "/dev", "--size", str(SHARED_MEMORY_MB << 20), "--tmpfs", "/dev/shm"]
    for path in paths:  # after /tmp, which may contain some of them
        out += ["--symlink", str(path.readlink()), str(path)] if _is_top_link(path) else ["--ro-bind", *[str(path)] * 2]
    return [*out, "--remount-ro", "/", "--chdir", "/job", "--", *command]


SCRIPT = f"""
job=$1; shift
root=$job/tmp/root
mkdir "$root"
mount -t tmpfs -o mode=755,size=16m tmpfs "$root"
mkdir -p "$root/proc" "$root/dev/shm" "$root/job" "$root/tmp"
mount --bind "$job" "$root/job"
mount --bind "$job/tmp" "$root/tmp"
see() {{
    if [ -d "$1" ]; then mkdir -p "$root$1"; else mkdir -p "$(dirname "$root$1")"; : > "$root$1"; fi
    mount --bind "$1" "$root$1"
}}
while [ "$1" != -- ]; do
    if [ "$1" = link ]; then
        shift
        ln -s "$(readlink "$1")" "$root$1"
    else
        see "$1"
        mount -o remount,bind,ro "$root$1"
    fi
    shift
done
shift
for device in null zero full random urandom; do see /dev/$device; done
mount -t tmpfs -o mode=1777,size={SHARED_MEMORY_MB}m tmpfs "$root/dev/shm"
mount -t proc proc "$root/proc"
for name in {" ".join(KERNEL)}; do
    [ -e "$root/proc/$name" ] || continue
    mount --bind "$root/proc/$name" "$root/proc/$name"
    mount -o remount,bind,ro "$root/proc/$name"
done
mount -o remount,ro "$root"
hostname tracker
cd "$root"
pivot_root . .
umount -l .
cd /job
rmdir tmp/root
exec setpriv --no-new-privs --bounding-set=-all --inh-caps=-all --ambient-caps=-all -- "$@"
"""
"""The equivalent of bubblewrap with the tools of util-linux."""


def _unshare(command: Sequence[str], folder: Path, paths: Sequence[Path]) -> list[str]:
    out = [
        "unshare",
        "--user",
        "--map-root-user",
        "--mount",
        "--pid",
        "--net",
        "--ipc",
        "--uts",
        "--fork",
        "--kill-child",
    ]
    out += ["sh", "-euc", SCRIPT, "sh", str(folder)]
    for path in paths:
        out += ["link", str(path)] if _is_top_link(path) else [str(path)]
    return [*out, "--", *command]


def _is_top_link(path: Path) -> bool:
    """Whether a path is a top-level link into /usr, as /bin is on most systems."""
    return path.is_symlink() and len(path.parts) == 2


def _prefixes(program: str) -> Iterator[Path]:
    """Prefixes of a Python: its installation, and its virtual environment if it has one."""
    found = shutil.which(program)
    path = Path(found).absolute() if found else None
    while path is not None:
        root = path.parent.parent
        python = (root / "pyvenv.cfg", root / "conda-meta", *root.glob("lib/python3*/os.py"))
        if root != Path("/") and any(sign.exists() for sign in python):
            yield from (root / name for name in PREFIX)
        path = path.parent / path.readlink() if path.is_symlink() else None
