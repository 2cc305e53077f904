"""Worker processes: the task of one that dies is done again, all have one thread, and the environment here stays as it was."""

import os
import subprocess
import sys
from collections import Counter
from threading import Event, Thread

import pytest
from support.places import SOURCE

from volid.backend import processes
from volid.backend.processes import ONE_THREAD, Died, in_processes, single_threaded_environment


def test_tasks_whose_process_dies_are_done_again_and_then_named():
    code = "__import__('os')._exit(1) if i == 1 else i * i"  # eval is a function that every process has
    found = dict(in_processes(eval, [({"i": i},) for i in range(4)], code, 2))
    assert isinstance(found.pop(1), Died) and found == {0: 0, 2: 4, 3: 9}


def test_processes_are_renewed_and_exceptions_are_raised(monkeypatch):
    monkeypatch.setattr(processes, "RENEW", 2)
    found = dict(in_processes(eval, [({"i": i},) for i in range(7)], "__import__('os').getpid(), i", 2))
    assert [found[i][1] for i in range(7)] == list(range(7))
    count = Counter(number for number, _ in found.values())
    assert len(count) >= 4 and max(count.values()) <= 2
    with pytest.raises(ZeroDivisionError):
        list(in_processes(eval, [({"i": i},) for i in range(3)], "1 // i", 2))


def test_workers_have_one_thread_and_the_environment_here_stays(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    before = dict(os.environ)
    names = sorted(ONE_THREAD)
    code = f"[__import__('os').environ[n] for n in {names}]"
    results = in_processes(eval, [({"i": i},) for i in range(3)], code, 2)
    assert next(results)[1] == [ONE_THREAD[n] for n in names] and dict(os.environ) == before
    results.close()
    assert dict(os.environ) == before


def test_the_environment_returns_when_the_last_of_several_threads_leaves(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    before, entered, leave = dict(os.environ), Event(), Event()

    def other():
        with single_threaded_environment():
            entered.set()
            leave.wait()

    thread = Thread(target=other)
    with single_threaded_environment():
        thread.start()
        entered.wait()
    assert os.environ["OMP_NUM_THREADS"] == "1"
    leave.set()
    thread.join()
    assert dict(os.environ) == before


def test_every_process_of_many_may_die():
    """Also while others are being started."""
    code = "__import__('os')._exit(1) if i % 3 else i"
    found = dict(in_processes(eval, [({"i": i},) for i in range(8)], code, 4))
    assert {i: r for i, r in found.items() if not isinstance(r, Died)} == {0: 0, 3: 3, 6: 6} and len(found) == 8


def test_a_script_without_main_guard_is_told(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(  # what is shared is larger than a pipe holds
        "from volid.backend.processes import in_processes\n"
        "print(list(in_processes(eval, [({'i': 1},)], 'i' + 10**6 * ' ', 1)))\n"
    )
    environment = os.environ | {"PYTHONPATH": str(SOURCE)}
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, timeout=60)
    assert done.returncode == 1
    assert 'VolidError: worker processes do not start; in a script, call this under `if __name__ == "__main__":`' in (
        done.stderr
    )
