#!/usr/bin/python3
"""What goes wrong around the program, one fault at a time, and what must hold then.

    tests/scenarios/faults.py PATH_OF_PROACT [NAME...]

Disk full, disk read-only, folder that may not be written, file limit, clock jump, half-open sockets, slow readers, a crowd of
pages, a line with a delay, floods of UDP, one core taken away, standard output closed or full. docs/reliability.md has the promises. Faults that this machine cannot be given (no
user namespaces, no libfaketime) are said to be skipped. Exit code 0 only if all others passed.
"""

import json
import os
import pathlib
import queue
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

from page_client import PageClient, ServeProcess

proact = pathlib.Path(sys.argv[1]).resolve()
work = pathlib.Path(tempfile.mkdtemp(prefix="proact-faults-"))
# Simulated seconds for one of the clock, below which a trial is not being kept up. The machine may have other work.
MIN_REAL_TIME_FACTOR = 0.5
# What a server may take more after a fault than before, MB.
MAX_GROWTH_MB = 30


class Skipped(Exception):
    """This machine cannot be given the fault."""


def demand(holds, what):
    if not holds:
        raise AssertionError(what)


def run(*words, prefix=(), **more):
    done = subprocess.run([*prefix, proact, *words], capture_output=True, text=True, timeout=120, **more)
    demand("panicked" not in done.stderr, done.stderr)
    return done


def in_mount(script, options):
    """Runs a shell script where `$dir` is a file system of its own with these options, and `$proact` the program."""
    folder = work / "mounted"
    folder.mkdir(exist_ok=True)
    mount = f'mount -t tmpfs -o {options} tmpfs "$dir" && {script}'
    environment = {**os.environ, "dir": str(folder), "proact": str(proact)}
    probe = subprocess.run(["unshare", "-rm", "sh", "-c", f'mount -t tmpfs tmpfs "{folder}"'], capture_output=True)
    if probe.returncode != 0:
        raise Skipped(f"no file system can be mounted here: {probe.stderr.decode().strip()}")
    done = subprocess.run(
        ["unshare", "-rm", "sh", "-c", mount], env=environment, capture_output=True, text=True, timeout=120
    )
    demand("panicked" not in done.stderr, done.stderr)
    return done


def disk_full():
    """The trial ends with an error that names the file; what was written before replays."""
    done = in_mount(
        '{ "$proact" demo --headless --out "$dir/t"; echo "exit $?"; "$proact" replay "$dir/t"; echo "exit $?"; }', "size=6m"
    )
    demand("No space left on device" in done.stderr, done.stderr)
    codes = [line for line in done.stdout.splitlines() if line.startswith("exit")]
    demand(codes == ["exit 1", "exit 0"], done.stdout + done.stderr)
    demand("agrees" in done.stdout and "interrupted" in done.stdout, done.stdout)
    return done.stdout.splitlines()[-2]


def disk_read_only():
    """Refused before anything runs."""
    done = in_mount('mount -o remount,ro "$dir" && "$proact" demo --headless --out "$dir/t"; echo "exit $?"', "size=6m")
    demand("Read-only file system" in done.stderr and "exit 1" in done.stdout, done.stdout + done.stderr)
    return done.stderr.strip()


def one_input_of_each_kind():
    """A trial, a study with a plan and a table of samples, from which each kind of file can be made."""
    folder = work / "made"
    if not folder.exists():
        folder.mkdir()
        made = run("demo", "--headless", "--set", "limit_secs=2", "--out", folder / "trial")
        demand(made.returncode == 0, made.stderr)
        demand(run("study", "new", folder / "pilot").returncode == 0, "no study could be made")
        # More than fits on the small disks.
        shutil.copy(folder / "trial" / "trial.bag", folder / "pilot")
        # Noise: a column that counts is no muscle and is refused.
        rng = random.Random(1)
        rows = [",".join(str(rng.randint(-128, 127)) for _ in range(8)) for _ in range(20_000)]
        (folder / "samples.csv").write_text("\n".join(rows) + "\n")
    return folder


def disk_full_outputs():
    """A file that does not fit is named; the one that was there before stays, and nothing else is left beside it."""
    made = one_input_of_each_kind()
    writers = {
        "features": f'emg features --csv "{made}/samples.csv" --window 20 --increment 5 --unit samples --out',
        "xdf": f'export "{made}/trial" --xdf',
        "archive": f'study archive "{made}/pilot" --out',
        "tables": f'study export "{made}/pilot" --out',
        "report": f'analyze "{made}/trial" --out',
    }
    for name, words in writers.items():
        # What is to be new cannot be there before.
        old = 'echo old > "$dir/out";' if name == "features" else ""
        show = 'ls -A "$dir"; cat "$dir/out"' if old else 'ls -A "$dir"'
        # With room for the beginning of each, so that the file can be made.
        fill = 'dd if=/dev/zero of="$dir/fill" bs=1k 2>"$dir/../dd"; truncate -s -12K "$dir/fill";'
        done = in_mount(f'{old} {fill} "$proact" {words} "$dir/out"; echo "exit $?"; {show}', "size=64k")
        demand("exit 1" in done.stdout and "No space left on device" in done.stderr, f"{name}: {done.stdout}{done.stderr}")
        demand("mounted/out" in done.stderr, f"{name} does not name the file: {done.stderr}")
        if old:
            demand(done.stdout.endswith("fill\nout\nold\n"), f"{name}: {done.stdout}")
        elif name != "tables":
            demand(done.stdout.endswith("exit 1\nfill\n"), f"{name}: {done.stdout}")
    return f"{', '.join(writers)} name the file"


def study_on_a_full_disk():
    """Made on a full disk, a study is not there, or says what happened; with room it goes on."""
    fill = 'dd if=/dev/zero of="$dir/fill" bs=1k 2>"$dir/../dd"'
    steps = [
        '"$proact" study new "$dir/s"',
        fill,
        '"$proact" study new "$dir/none"',
        'ls -d "$dir/none"',
        '"$proact" study run "$dir/s" --simulated',
        '"$proact" study status "$dir/s"',
        'rm "$dir/fill"',
        '"$proact" study new "$dir/none"',
        ': > "$dir/none/plan.toml"; "$proact" study status "$dir/none"',
    ]
    done = in_mount("; ".join(f'{{ {step}; }}; echo "exit $?"' for step in steps), "size=64k")
    codes = [line.split()[1] for line in done.stdout.splitlines() if line.startswith("exit")]
    demand(codes == ["0", "1", "1", "2", "1", "1", "0", "0", "1"], f"{codes}: {done.stdout}{done.stderr}")
    demand("none/plan.toml: No space left on device" in done.stderr, done.stderr)
    demand("study.sqlite is empty: the program that made it ended" in done.stderr, done.stderr)
    demand("the plan is empty, so it was not written to its end" in done.stderr, done.stderr)
    return "each says what happened"


# Each would work for minutes, or wait for a person, if it were not refused before.
LONG_WRITERS = [
    "emg train --source synthetic --repetition-seconds 60 --out $dir/new",
    "emg train --source synthetic --repetition-seconds 60 --out $made/new.json --save $dir/new",
    "emg test --source synthetic --model $made/none.json --tests trial --adapt $dir/new",
    "demo --headless --out $dir/new",
    "serve --no-browser --port 0 --out $dir/new",
    "simulate --out $dir/new --participants 100",
    "compare A B --out $dir/new --participants 100",
    "participants fit --out $dir/new",
    "participants predict --out $dir/new",
    "analyze $made/trial --out $dir/new",
    "study export $made/pilot --out $dir/new",
    "study archive $made/pilot --out $dir/new",
    "study power $made/pilot --pilot $made/trial --figure $dir/new",
    "study new $dir/new",
    "export $made/trial --xdf $dir/new",
    "localize record $made/none.csv --out $dir/new",
    "bench growth --charts $dir/new",
    "model size mpl_right --stature 1.7 --out $dir/new",
    "reference $dir/new",
    "man $dir/new",
]


def check_outputs_refused(run_with, why):
    begun = []
    for words in LONG_WRITERS:
        try:
            done = run_with(f'"$proact" {words}; echo "exit $?"')
        except subprocess.TimeoutExpired:
            begun.append(f"{words}: it began")
            continue
        if "exit 1" not in done.stdout or why not in done.stderr:
            begun.append(f"{words}: {done.stdout}{done.stderr}")
    demand(not begun, "\n".join(begun))
    return f"{len(LONG_WRITERS)} commands are refused before they begin"


def read_only_outputs():
    """Refused before any work."""
    made = one_input_of_each_kind()

    def run_with(script):
        return in_mount(f'mount -o remount,ro "$dir"; made="{made}"; {script}', "size=64k")

    return check_outputs_refused(run_with, "Read-only file system")


def outputs_without_permission():
    """The same for a folder that this user may not write to."""
    made = one_input_of_each_kind()
    folder = work / "forbidden"
    folder.mkdir()
    folder.chmod(0o555)
    prefix = []
    if os.getuid() == 0:
        # Root may write anywhere.
        prefix = ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups"]
        for path in [work, made, *made.rglob("*")]:
            path.chmod(0o755 if path.is_dir() else 0o644)
        if subprocess.run([*prefix, proact, "--version"], capture_output=True).returncode != 0:
            raise Skipped("no other user can run the program here")
    environment = {**os.environ, "dir": str(folder), "made": str(made), "proact": str(proact)}

    def run_with(script):
        command = [*prefix, "sh", "-c", script]
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)

    return check_outputs_refused(run_with, "Permission denied")


def file_limit():
    """`ulimit -f`: as a full disk, and not the end by a signal."""
    folder = work / "limited"
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
    done = run("demo", "--headless", "--out", folder, preexec_fn=limit)
    demand(done.returncode == 1 and "File too large" in done.stderr, f"{done.returncode}: {done.stderr}")
    replayed = run("replay", folder, "--json")
    demand(replayed.returncode == 0 and json.loads(replayed.stdout)["agrees"], replayed.stderr)
    return done.stderr.strip()


def output_closed():
    """Standard output that is full or that nobody reads: an exit code and a sentence; the record is whole."""
    for number, out in enumerate(["/dev/full", "|true"]):
        folder = work / f"closed{number}"
        if out == "|true":
            reader, writer = os.pipe()
            os.close(reader)
        else:
            writer = os.open(out, os.O_WRONLY)
        done = subprocess.run(
            [proact, "demo", "--headless", "--out", folder], stdout=writer, stderr=subprocess.PIPE, text=True
        )
        os.close(writer)
        demand(done.returncode == 1 and "cannot write to standard output" in done.stderr, done.stderr)
        demand("panicked" not in done.stderr, done.stderr)
        demand(json.loads(run("replay", folder, "--json").stdout)["finished"], f"{folder} is not whole")
    silent = os.open("/dev/full", os.O_WRONLY)
    code = subprocess.run([proact, "demo", "--headless", "--no-record"], stdout=subprocess.DEVNULL, stderr=silent)
    os.close(silent)
    demand(code.returncode == 0, f"without anybody to tell, the trial ended with {code.returncode}")
    return done.stderr.strip()


class MonitoredServer:
    """A server with a page that drives, and how well it keeps up."""

    def __init__(self, name, *words, **more):
        self.folder = work / name
        self.server = ServeProcess(proact, random.randint(20000, 30000), self.folder, *words, **more)
        self.page = PageClient(self.server.port)
        self.drive(1)
        self.memory = self.resident_mb()

    def resident_mb(self):
        with open(f"/proc/{self.server.process.pid}/status") as status:
            return next(int(line.split()[1]) // 1024 for line in status if line.startswith("VmRSS"))

    def drive(self, seconds):
        """Drives for so long; simulated seconds for one of the clock."""
        begin, first, last = time.monotonic(), None, None
        gestures = ["wrist_extension", "no_motion"]
        while time.monotonic() < begin + seconds:
            self.page.send(type="gesture", gesture=gestures[int(time.monotonic()) % 2])
            last = self.page.frame()["time"]
            first = first or (last, time.monotonic())
        return (last - first[0]) * 1e-3 / (time.monotonic() - first[1])

    def stop_and_check(self, pace):
        """Ends it well, and demands what must always hold; a line about it."""
        memory = self.resident_mb()
        demand(self.server.stop(signal.SIGTERM) == 0, self.server.output_text())
        demand("panicked" not in self.server.output_text(), self.server.output_text())
        for folder in self.folder.iterdir():
            replayed = json.loads(run("replay", folder, "--json").stdout)
            demand(replayed["agrees"] and replayed["finished"], f"{folder}: {replayed}")
        demand(pace > MIN_REAL_TIME_FACTOR, f"the trial went at {pace:.2f} of real time")
        demand(memory < self.memory + MAX_GROWTH_MB, f"{self.memory} MB before, {memory} MB after")
        return f"pace {pace:.3f}, {self.memory} MB before, {memory} MB after"


def clock_jump():
    """The clock of the day is set forth and back by an hour: nothing in a trial goes by it."""
    library = next(pathlib.Path("/usr/lib").glob("*/faketime/libfaketime.so.1"), None)
    if library is None:
        raise Skipped("libfaketime is not installed (sudo apt install faketime)")
    offset = work / "offset"
    offset.write_text("+0")
    environment = {
        **os.environ,
        "LD_PRELOAD": str(library),
        "FAKETIME_TIMESTAMP_FILE": str(offset),
        "FAKETIME_NO_CACHE": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }
    watched = MonitoredServer("clock", env=environment)
    paces = []
    for jump in ["+3600", "-7200", "+0"]:
        offset.write_text(jump)
        paces.append(watched.drive(2))
    return watched.stop_and_check(min(paces))


def half_open_connections():
    """A thousand connections that ask for nothing, and some that ask one byte at a time."""
    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    watched = MonitoredServer("half-open")
    sockets = []
    for number in range(1000):
        one = socket.socket()
        one.settimeout(1)
        try:
            one.connect(("127.0.0.1", watched.server.port))
            one.send(b"G" if number % 2 else b"GET / HTTP/1.1\r\nHost: loc")
        except OSError:
            pass
        sockets.append(one)
    # What was drawn while they connected comes first.
    watched.drive(1)
    pace = watched.drive(5)
    for one in sockets:
        one.close()
    time.sleep(0.5)
    PageClient(watched.server.port).frame()
    return watched.stop_and_check(pace)


def slow_readers():
    """Twenty pages that never read what they are sent."""
    watched = MonitoredServer("slow")
    slow = [PageClient(watched.server.port, "spectator", receive_buffer=2048) for _ in range(20)]
    pace = watched.drive(8)
    report = watched.stop_and_check(pace)
    del slow
    return report


def many_clients():
    """Seventy pages of each kind that only watch: driver and experimenter come in all the same."""
    watched = MonitoredServer("crowd")
    pages, refused = [], 0
    for role in ["spectator", "participant", "experimenter"]:
        for _ in range(70):
            try:
                pages.append(PageClient(watched.server.port, role))
            except ConnectionError as error:
                demand(role == "spectator" and "503" in str(error), f"{role}: {error}")
                refused += 1
    demand(refused == 6, f"{refused} of 70 spectators were refused, 64 have places")
    for role in ["participant", "experimenter"]:
        PageClient(watched.server.port, role).frame()
    pace = watched.drive(3)
    del pages
    return watched.stop_and_check(pace)


class DelayProxy:
    """A line to a port of this machine whose bytes come later by `secs` in each direction."""

    def __init__(self, port, secs):
        self.target, self.secs = port, secs
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.port = self.listening.getsockname()[1]
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        while True:
            near = self.listening.accept()[0]
            far = socket.create_connection(("127.0.0.1", self.target))
            for source, sink in [(near, far), (far, near)]:
                waiting = queue.Queue()
                threading.Thread(target=self.read, args=(source, waiting), daemon=True).start()
                threading.Thread(target=self.write, args=(waiting, sink), daemon=True).start()

    def read(self, source, waiting):
        while data := source.recv(1 << 16):
            waiting.put((time.monotonic() + self.secs, data))

    def write(self, waiting, sink):
        while True:
            due, data = waiting.get()
            time.sleep(max(due - time.monotonic(), 0))
            sink.sendall(data)


def delayed_connection():
    """A page holds a gesture over a line with 200 ms each way: all that it says comes, and none of it moves the arm."""
    watched = MonitoredServer("delay", "--method", "A")
    page = PageClient(DelayProxy(watched.server.port, 0.2).port)
    page.send(type="take_over")
    messages = (page.receive() for _ in range(600))
    warning = next((message for message in messages if message and message["type"] == "delay"), None)
    demand(warning and warning["ms"] >= 400, f"the page is warned by {warning}")
    page.send(type="gesture", gesture="wrist_extension")
    joints = page.frame()["joints"]
    for _ in range(600):
        page.send(type="alive")
        frame = page.frame()
        if frame["stop"]:
            break
    stop = frame["stop"]
    # A machine under load may find the page silent before its line is measured; either keeps the arm still.
    demand(stop and stop["source"] == "page" and stop["cause"] in ("delayed", "silent"), f"stopped by {stop}")
    moved = max(abs(a - b) for a, b in zip(joints, frame["joints"]))
    demand(moved < 1e-3, f"a joint moved by {moved} rad")
    page.close()
    return f"{stop['reason']}; {watched.stop_and_check(1)}"


def udp_flood():
    """Gaze and limb as fast as this machine can send, of every length, with and without sense."""
    gaze, limb = random.randint(31000, 32000), random.randint(32001, 33000)
    watched = MonitoredServer("flood", "--gaze-udp", str(gaze), "--limb-udp", str(limb))
    stop = threading.Event()
    sent = [0]

    def flood():
        rng, out = random.Random(1), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sense = [b'{"origin":[0,0,1.5],"direction":[0.6,0,-0.7]}', b'{"angles":[0,0,0,0.5,0,0,0]}', b"[]", b"{"]
        while not stop.is_set():
            data = rng.choice(sense) if rng.random() < 0.5 else rng.randbytes(rng.choice([0, 1, 60, 1400, 60000]))
            for port in (gaze, limb):
                out.sendto(data, ("127.0.0.1", port))
                sent[0] += 1

    threading.Thread(target=flood).start()
    try:
        pace = watched.drive(6)
    finally:
        stop.set()
    lines = len(watched.server.output_text().splitlines())
    demand(lines < 200, f"{lines} lines were said of {sent[0]} packets")
    return f"{watched.stop_and_check(pace)}, {sent[0]} packets, {lines} lines said"


def one_core():
    """Server and a program that never rests on one and the same core."""
    hog = subprocess.Popen(["taskset", "-c", "0", sys.executable, "-c", "while True: pass"])
    try:
        watched = MonitoredServer("one-core", prefix=["taskset", "-c", "0"])
        return watched.stop_and_check(watched.drive(5))
    finally:
        hog.kill()


FAULTS = [
    disk_full, disk_read_only, disk_full_outputs, study_on_a_full_disk, read_only_outputs, outputs_without_permission,
    file_limit, output_closed, clock_jump, half_open_connections, slow_readers, many_clients, delayed_connection, udp_flood, one_core
]
wanted = sys.argv[2:]
failed = False
for fault in FAULTS:
    if wanted and fault.__name__ not in wanted:
        continue
    try:
        print(f"ok       {fault.__name__:15} {fault()}", flush=True)
    except Skipped as reason:
        print(f"skipped  {fault.__name__:15} {reason}", flush=True)
    except (AssertionError, ConnectionError, RuntimeError, OSError, subprocess.SubprocessError) as error:
        failed = True
        print(f"FAILED   {fault.__name__:15} {type(error).__name__}: {error}; see {work}", flush=True)
if not failed:
    shutil.rmtree(work)
sys.exit(failed)
