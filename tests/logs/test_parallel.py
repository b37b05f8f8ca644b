"""Work in threads: results in order, few jobs at a time, and no thread where none is worth it."""

import threading
import time

import pytest

from ident.logs import parallel
from ident.logs.parallel import in_order


def who(job):
    time.sleep(0.002 * (job % 3))
    return job, threading.current_thread() is threading.main_thread()


def test_results_come_in_the_order_of_the_jobs(monkeypatch):
    monkeypatch.setattr(parallel, "threads", lambda: 3)
    assert list(in_order(who, range(50))) == [(job, False) for job in range(50)]


@pytest.mark.parametrize(("count", "processors"), [(1, 3), (50, 1), (0, 3)])
def test_no_thread_is_made_for_one_job_or_on_one_processor(monkeypatch, count, processors):
    monkeypatch.setattr(parallel, "threads", lambda: processors)
    assert list(in_order(who, range(count))) == [(job, True) for job in range(count)]


@pytest.mark.parametrize("processors", [1, 2])
def test_jobs_are_taken_as_they_are_needed(monkeypatch, processors):
    monkeypatch.setattr(parallel, "threads", lambda: processors)
    taken = []
    results = in_order(who, (taken.append(job) or job for job in range(1000)))
    assert next(results)[0] == 0
    assert len(taken) <= processors + parallel.AHEAD + 1
    results.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("unpack")]


@pytest.mark.parametrize("processors", [1, 2])
def test_an_error_in_a_job_comes_out_where_its_result_would(monkeypatch, processors):
    monkeypatch.setattr(parallel, "threads", lambda: processors)
    results = in_order(lambda job: 1 // (3 - job), range(10))
    assert [next(results) for _ in range(3)] == [0, 0, 1]
    with pytest.raises(ZeroDivisionError):
        next(results)
