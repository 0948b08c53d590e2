"""Guard process: removes a temporary folder and kills a tree of processes when its owner ends; see `guard`.

Run as `python -I -S guard_process.py SOCKET PREFIX`, which starts quickly and loads no user code. The protocol is lines
of JSON over the socket. To the owner: `{"folder": ...}`, and `{"code": ..., "used_mb": ...}` once the program has
ended. From the owner: one `{"command": ..., "environment": ..., "cwd": ..., "memory_mb": ..., "file_mb": ..., "cpu_s":
...}` with the program's three standard file descriptors, and `{"end": true}`. When the owner ends, for whatever reason,
the socket closes, and the guard cleans up. The guard is two processes, a child that serves the owner and a parent that
only waits: if either is killed, the other one cleans up.
"""

import ctypes
import json
import os
import resource
import select
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from shutil import rmtree
from typing import Any

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  # linux/prctl.h
SAMPLE_S = 0.1
"""Polling interval for the total memory of all processes, and for the owner, s."""
LOOKS = 5
"""Attempts to read the memory of all processes while some of them start or end."""
GIVE_UP_S = 10.0
"""Timeout for killed processes to end, s."""


def main() -> None:
    """Create the folder, serve the owner in a child process, and clean up."""
    owner, owner_pid = socket.socket(fileno=int(sys.argv[1])), os.getppid()
    owner.set_inheritable(False)
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)
    _prctl(PR_SET_CHILD_SUBREAPER, 1)
    told = Told()
    folder = os.path.realpath(tempfile.mkdtemp(prefix=sys.argv[2]))
    try:
        parent = os.getpid()
        child = os.fork()
        if child:
            owner.close()
            outlive(child, owner_pid, told)
        else:
            os.setsid()  # signals to the parent's process group do not reach the child
            _prctl(PR_SET_CHILD_SUBREAPER, 1)  # a child does not inherit it
            Guarding(owner, parent, Told()).serve(folder)
    except OSError:
        pass  # the owner has ended
    finally:
        end_descendants()
        remove(folder)


def remove(folder: str) -> None:
    """Remove a folder; what `rmtree` cannot, too deep or without permissions, is left to the system's programs."""
    if Path(folder).is_symlink():
        Path(folder).unlink()
    with suppress(RecursionError):
        rmtree(folder, ignore_errors=True)
    if os.path.lexists(folder):
        for command in (["chmod", "-R", "u+rwx", folder], ["rm", "-rf", folder]):
            os.spawnvp(os.P_WAIT, command[0], command)


class Told:
    """Signals that wake this process: SIGCHLD at the end of a child, and SIGTERM as the request to end."""

    def __init__(self) -> None:
        self.woken, wake = os.pipe()
        os.set_blocking(wake, False)
        os.set_blocking(self.woken, False)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        self.to_end = False
        for number in (signal.SIGCHLD, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, _: object) -> None:
        self.to_end |= number == signal.SIGTERM

    def wait(self, *others: int) -> set[int]:
        """Wait for a signal, a readable file or SAMPLE_S, whichever is first; the readable ones among `others`."""
        poll = select.poll()
        for handle in (self.woken, *others):
            poll.register(handle, select.POLLIN)
        ready = {handle for handle, _ in poll.poll(SAMPLE_S * 1e3)}
        if self.woken in ready:
            os.read(self.woken, 1 << 12)
        return ready


def outlive(child: int, owner_pid: int, told: Told) -> None:
    """Wait for the serving child, and send it SIGTERM when the owner has ended or on SIGTERM."""
    while not any(pid == child for pid, _ in reap()):
        if told.to_end or os.getppid() != owner_pid:
            _signal([child], signal.SIGTERM)
        told.wait()


class Guarding:
    """Connection to the owner, and the program once it is started."""

    def __init__(self, owner: socket.socket, parent: int, told: Told) -> None:
        self.owner, self.parent, self.told = owner, parent, told
        self.program, self.memory_mb, self.reported = 0, 0, False
        self.codes: dict[int, int] = {}
        self.received, self.files = b"", list[int]()

    def serve(self, folder: str) -> None:
        """Serve the owner's requests until it ends."""
        self.tell({"folder": folder})
        while not self.told.to_end and os.getppid() == self.parent:
            if self.owner.fileno() in self.told.wait(self.owner.fileno()) and not self.listen():
                return
            self.look_after()

    def listen(self) -> bool:
        """Carry out the owner's messages; False when the owner has ended."""
        data, files, _, _ = socket.recv_fds(self.owner, 1 << 16, 3)
        for handle in files:
            os.set_inheritable(handle, False)
        self.files += files
        self.received += data
        while b"\n" in self.received:
            line, _, self.received = self.received.partition(b"\n")
            asked = json.loads(line)
            if "command" in asked:
                self.start(asked)
            else:
                self.codes.update(end_descendants())
        return bool(data)

    def start(self, asked: dict[str, Any]) -> None:
        """Start the program in its own session."""
        self.memory_mb, guard = asked["memory_mb"], os.getpid()
        self.program = os.fork()
        if self.program:
            for handle in self.files:
                os.close(handle)
            return
        try:
            os.setsid()
            for number in (signal.SIGINT, signal.SIGHUP, signal.SIGPIPE, signal.SIGCHLD, signal.SIGTERM):
                signal.signal(number, signal.SIG_DFL)
            die_with(guard)
            for target, handle in enumerate(self.files):
                os.dup2(handle, target)
            os.chdir(asked["cwd"])
            limit(asked["memory_mb"], asked["file_mb"], asked["cpu_s"])
            os.execvpe(asked["command"][0], asked["command"], asked["environment"])
        except OSError as error:
            os.write(2, f"{asked['command'][0]}: {error.strerror}\n".encode())
        finally:
            os._exit(127)

    def look_after(self) -> None:
        """Reap ended processes; kill the rest when the program has ended or their total memory exceeds the limit."""
        self.codes.update(reap())
        if not self.program or self.reported:
            return
        used_mb = 0.0 if self.program in self.codes else used_memory_mb(self.memory_mb)
        if used_mb or self.program in self.codes:
            self.codes.update(end_descendants())
            self.reported = True
            self.tell({"code": self.codes.get(self.program, -signal.SIGKILL), "used_mb": used_mb})

    def tell(self, what: dict[str, Any]) -> None:
        """Send a line to the owner."""
        self.owner.sendall(json.dumps(what).encode() + b"\n")


def limit(memory_mb: int, file_mb: int, cpu_s: int) -> None:
    """Limit address space, file size and processor time of this process and its children, and disable core dumps.

    0 for no limit; a lower limit that is there already stays. Processor time has a soft limit: its signal, SIGXCPU,
    says why the process ended.
    """
    limits = {resource.RLIMIT_AS: memory_mb << 20, resource.RLIMIT_FSIZE: file_mb << 20, resource.RLIMIT_CPU: cpu_s}
    for what, most in limits.items():
        if most:
            _, hard = resource.getrlimit(what)
            soft = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(what, (soft, hard if what == resource.RLIMIT_CPU else soft))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def die_with(parent: int) -> None:
    """Make the kernel kill this process when its parent thread ends; exit if the parent has already ended."""
    _prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def nobody(_: int) -> bool:
    """Spares no process."""
    return False


def end_descendants(spares: Callable[[int], bool] = nobody) -> list[tuple[int, int]]:
    """Kill all descendants of this process, in any session; (pid, exit code) of its direct children.

    They are stopped first, so that none forks in the meantime. spares: which processes live on with their descendants.
    """
    ended: list[tuple[int, int]] = list(reap())
    deadline = time.monotonic() + GIVE_UP_S
    while (living := descendants(os.getpid(), spares)) and time.monotonic() < deadline:
        _signal(living, signal.SIGSTOP)
        _signal(living | descendants(os.getpid(), spares), signal.SIGKILL)
        time.sleep(0.002)
        ended += reap()
    return ended


def is_guard(pid: int) -> bool:
    """Whether a process is a guard, which cleans up by itself when its owner ends."""
    with suppress(OSError):
        return os.fsencode(__file__) in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    return False


def reap() -> Iterator[tuple[int, int]]:
    """(pid, exit code) of the children that have ended; the code is minus the signal, as in `subprocess`."""
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            yield ended[0], os.waitstatus_to_exitcode(ended[1])


def descendants(root: int, spares: Callable[[int], bool] = nobody) -> set[int]:
    """All descendants of a process but those that are spared and theirs."""
    found: set[int] = set()
    todo = [root]
    while todo:
        new = [pid for pid in children(todo.pop()) if pid not in found and not spares(pid)]
        found.update(new)
        todo += new
    return found


def children(pid: int) -> Iterator[int]:
    """Children of a process; empty without /proc."""
    with suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                yield from map(int, (task / "children").read_text().split())
    if not Path("/proc/thread-self/children").exists():  # a kernel without CONFIG_PROC_CHILDREN
        with suppress(OSError):
            others = (int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit())
            yield from (other for other in others if _parent(other) == pid)


def _parent(pid: int) -> int:
    with suppress(OSError, IndexError):
        return int(_read(f"/proc/{pid}/stat").rpartition(")")[2].split()[1])
    return 0


def used_memory_mb(limit_mb: int) -> float:
    """Total memory of all descendants in MB if it exceeds the limit, else 0.

    Measured as the resident set size, which counts shared pages once per process; where that exceeds the limit, as the
    proportional set size, which is slower to read. The sum of proportional sizes is valid only while no process starts
    or ends, since the shared pages of a process that ends are then divided among fewer.
    """
    used = 0.0
    for _ in range(LOOKS):
        resident = _resident_mb_of_each()
        if not limit_mb or sum(resident.values()) <= limit_mb:
            return 0.0
        used = sum(map(_proportional_mb, resident))
        if used <= limit_mb:
            return 0.0
        if resident.keys() == _resident_mb_of_each().keys():
            break
    return used


def _resident_mb_of_each() -> dict[int, float]:
    """Resident memory of each running descendant."""
    return {pid: resident for pid in descendants(os.getpid()) if (resident := _resident_mb(pid))}


def _resident_mb(pid: int) -> float:
    with suppress(OSError, IndexError):
        return int(_read(f"/proc/{pid}/statm").split()[1]) * resource.getpagesize() / 2**20
    return 0.0


def _proportional_mb(pid: int) -> float:
    with suppress(OSError, StopIteration):
        lines = _read(f"/proc/{pid}/smaps_rollup").splitlines()
        return int(next(line for line in lines if line.startswith("Pss:")).split()[1]) / 1024
    return _resident_mb(pid)


def _read(path: str) -> str:
    return Path(path).read_text(encoding="ascii", errors="replace")


def _signal(pids: Iterable[int], number: int) -> None:
    for pid in pids:
        with suppress(OSError):
            os.kill(pid, number)


def _prctl(option: int, value: int) -> None:
    with suppress(OSError, AttributeError):  # Linux only; elsewhere the closed socket reports the owner's end
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


if __name__ == "__main__":
    main()
