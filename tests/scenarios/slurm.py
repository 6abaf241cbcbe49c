#!/usr/bin/python3
"""A batch as a job array of a Slurm of one node, which this starts itself: what is merged equals the local run.

    tests/scenarios/slurm.py PATH_OF_PROACT

Needs Debian's packages slurmctld, slurmd and slurm-client. Controller and node run on ports and in a folder of their own, without
any change to /etc, and are ended with the test. Exit code 0 only if all of it holds.
"""

import argparse
import contextlib
import getpass
import os
import pathlib
import shutil
import socket
import subprocess
import tempfile
import time

from batches import WORDS, contents, run

SHARDS = 3
PATIENCE_SECS = 180

# Jobs are told apart by their process groups, and nobody is asked who he is: the test is alone on its ports.
CONFIGURATION = """
ClusterName=proact
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={controller}
SlurmdPort={node}
AuthType=auth/none
CredType=cred/none
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
StateSaveLocation={place}/state
SlurmdSpoolDir={place}/spool
SlurmctldPidFile={place}/slurmctld.pid
SlurmdPidFile={place}/slurmd.pid
SlurmctldLogFile={place}/slurmctld.log
SlurmdLogFile={place}/slurmd.log
NodeName={host} NodeAddr=127.0.0.1 CPUs={processors} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def slurm(place):
    """A cluster of this machine; its environment."""
    for folder in ("state", "spool"):
        (place / folder).mkdir()
    host = socket.gethostname().split(".")[0]
    text = CONFIGURATION.format(
        host=host,
        user=getpass.getuser(),
        controller=free_port(),
        node=free_port(),
        place=place,
        processors=os.cpu_count(),
    )
    configuration = place / "slurm.conf"
    configuration.write_text(text)
    environment = {**os.environ, "SLURM_CONF": str(configuration)}
    path = f"{environment['PATH']}:/usr/sbin"
    daemons = []
    try:
        for daemon in (["slurmctld", "-D"], ["slurmd", "-D", "-N", host]):
            program = [shutil.which(daemon[0], path=path), *daemon[1:], "-f", str(configuration)]
            silent = subprocess.DEVNULL
            daemons.append(subprocess.Popen(program, env=environment, stdout=silent, stderr=silent))
        until(lambda: "idle" in asked(environment, "sinfo", "--noheader", "--format=%t"), "the node is idle", place)
        yield environment
    finally:
        for daemon in reversed(daemons):
            daemon.terminate()
            try:
                daemon.wait(timeout=20)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()


def asked(environment, *words):
    return subprocess.run(words, env=environment, capture_output=True, text=True, check=False).stdout


def until(holds, what, place):
    end = time.monotonic() + PATIENCE_SECS
    while not holds():
        if time.monotonic() > end:
            logs = [f"{log}: {log.read_text()[-2000:]}" for log in place.glob("slurm*.log")]
            raise AssertionError(f"not within {PATIENCE_SECS} s: {what}\n" + "\n".join(logs))
        time.sleep(0.3)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("binary", type=pathlib.Path)
    args = parser.parse_args()
    binary = args.binary.resolve()
    with tempfile.TemporaryDirectory() as place:
        place = pathlib.Path(place)
        run(binary, *WORDS, "--out", place / "local")
        with slurm(place) as environment:
            out = place / "with a blank"
            words = [binary, *WORDS, "--out", out, f"--slurm={SHARDS}", "--json"]
            done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            assert '"job"' in done.stdout and "no evidence about people" in done.stdout, done.stdout
            until(lambda: not asked(environment, "squeue", "--noheader").strip(), "the array has ended", place)
            logs = sorted((out / "slurm").glob("shard-*.log"))
            told = "\n".join(f"{log.name}: {log.read_text()}" for log in logs)
            assert len(logs) == SHARDS, f"a log for each task: {told}"
            assert (out / "trials.jsonl").is_file(), f"the task that ended last merged nothing: {told}"
            assert contents(out) == contents(place / "local"), "the array's trials are those of the local run"
        print(f"slurm: an array of {SHARDS} tasks gave the same bytes as the local run")


if __name__ == "__main__":
    main()
