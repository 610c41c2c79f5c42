"""Tables of sweeps, made on any executor."""

import random
import time
from concurrent.futures import ThreadPoolExecutor

from impact_damper_ros.sweep import Here, Journal, journal_path, run_sweep, write_table


def table_of(plan, path, executor=None, **options):
    """Run a sweep, or what is left of it, and return the bytes of its table."""
    with Journal(journal_path(path), plan.inputs()) as journal:
        run_sweep(plan, journal, executor or Here(), **{'at_once': 1, **options})
        write_table(plan, journal, path)
    journal_path(path).unlink()
    return path.read_bytes()


class Shuffled:
    """Any executor: here one that finishes in an order of its own, in threads."""

    def __init__(self):
        self.pool = ThreadPoolExecutor(3)
        self.chance = random.Random(4)

    def submit(self, fn, /, *args):
        delay = self.chance.random() * 0.02
        return self.pool.submit(self.run, delay, fn, args)

    @staticmethod
    def run(delay, fn, args):
        time.sleep(delay)
        return fn(*args)
