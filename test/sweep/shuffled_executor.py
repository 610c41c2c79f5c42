"""An executor that finishes its jobs in an order of its own."""

import random
import time
from concurrent.futures import ThreadPoolExecutor


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
