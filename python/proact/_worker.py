"""Python that a trial asks: in a thread of its own, so that what hangs does not hold the trial up."""

from __future__ import annotations

import queue
import threading
import traceback
from typing import Callable, Optional

#: Longest text of a fault: it is shown on a page.
_MAX_TEXT_BYTES = 300


class Worker:
    """Asks ``function``, from text to text, in a daemon thread. One question at a time."""

    def __init__(self, function: Callable[[str], str]):
        self._function = function
        self._questions: queue.SimpleQueue = queue.SimpleQueue()
        self._answers: queue.SimpleQueue = queue.SimpleQueue()
        self._question_count = 0
        self._answer_count = 0
        threading.Thread(target=self._serve, daemon=True, name="proact-worker").start()

    def _serve(self) -> None:
        while (question := self._questions.get()) is not None:
            number, text = question
            answer: tuple[Optional[str], Optional[str]]
            try:
                answer = (self._function(text), None)
            except BaseException as error:  # noqa: BLE001 - whatever it is, the arm must hold
                answer = (None, fault_text(error))
            self._answers.put((number, answer))

    def ask(self, text: str, timeout_secs: float) -> tuple[Optional[str], Optional[str]]:
        """(answer, None), (None, what it raised), or (None, None) if it is late. While it is late, nothing else is asked."""
        self._drop_late_answers()
        if self._answer_count < self._question_count:
            return None, None
        self._question_count += 1
        self._questions.put((self._question_count, text))
        try:
            number, answer = self._answers.get(timeout=timeout_secs)
        except queue.Empty:
            return None, None
        self._answer_count = number
        return answer

    def _drop_late_answers(self) -> None:
        """What came too late for its question is dropped."""
        while True:
            try:
                self._answer_count, _ = self._answers.get_nowait()
            except queue.Empty:
                return

    def close(self) -> None:
        """Ends the thread when it is done with what it is at."""
        self._questions.put(None)


def fault_text(error: BaseException) -> str:
    """What was raised and where, on one line."""
    text = f"raised {type(error).__name__}: {error}"
    trace = traceback.extract_tb(error.__traceback__)
    if trace:
        last = trace[-1]
        text += f' (line {last.lineno} of "{last.filename}")'
    text = "".join(c if c.isprintable() else " " for c in text)
    return text.encode("utf-8", "replace")[:_MAX_TEXT_BYTES].decode("utf-8", "ignore")
