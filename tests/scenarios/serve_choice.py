#!/usr/bin/python3
"""Chooses at the page of `serve` what cannot begin: the trial before goes on, and page or terminal say why.

    tests/scenarios/serve_choice.py PATH_OF_PROACT

Once with an arm that no decoder of miniVIE can drive, once with an arm that one could, while another program listens where it
would. Exit code 0 only if `serve` lives on and frames come.
"""

import json
import pathlib
import signal
import socket
import sys
import tempfile
import time

from page_client import PageClient, ServeProcess

TIMEOUT_SECS = 30


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def check_trial_continues(proact, work, arm, refused):
    """Asks the page of `serve` with `arm` for `vmpl`, until `refused(server, message)`; then a trial has to be shown all the same."""
    server = ServeProcess(proact, free_port(), work / arm, "--arm", arm, "--method", "A", "--time-limit", "60")
    page = PageClient(server.port)
    page.frame()
    page.send(type="restart", method="vmpl", again=True)
    end = time.monotonic() + TIMEOUT_SECS
    while not refused(server, page.receive()):
        assert server.process.poll() is None, f"{arm}: serve ended: {server.output_text()}"
        assert time.monotonic() < end, f"{arm}: nothing was refused: {server.output_text()}"
    assert page.frame(), arm
    code = server.stop(signal.SIGINT)
    assert code == 0, f"{arm}: ended with {code}: {server.output_text()}"
    print(f"ok: vmpl refused with {arm}, the trial before goes on", flush=True)


def not_offered(_server, message):
    return "expected one of A, B" in json.dumps(message)


def cannot_begin(server, _message):
    return "This trial cannot begin" in server.output_text() and "25000" in server.output_text()


def main():
    proact = pathlib.Path(sys.argv[1])
    with tempfile.TemporaryDirectory(prefix="proact-choice-") as folder:
        work = pathlib.Path(folder)
        check_trial_continues(proact, work, "wam", not_offered)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            try:
                other.bind(("127.0.0.1", 25000))
            except OSError:
                pass  # Somebody else listens there, which is as good.
            check_trial_continues(proact, work, "mpl_right", cannot_begin)


main()
