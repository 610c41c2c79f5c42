"""
What the page costs: CPU of its server, bytes and latency of its frames, and what the node feels.

    python benchmarks/page.py [--quick] [--json FILE]
    python benchmarks/page.py --theory
    python benchmarks/page.py --memory 60

Node, server and clients are processes of their own. The clients are WebSockets that take 60 frames
per second and count; they draw nothing. Latency is from the stamp of the newest joint state in a
frame, the instant at which it held, to the arrival of the frame at the client. The period error of
the node is that of `benchmarks/node.py`: between source timestamps, seen by one more subscriber.
``--theory`` measures only how long after a value of a knob the theory of that rig is at a page:
the predicted motion, the curve over the gap, and all motions; ``--memory`` only the memory of the
server with a client that never reads, for so many minutes.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from node_process import (
    DEADLINE_S,
    WARM_UP_S,
    Listener,
    anonymous_kib,
    cpu_seconds,
    deviations,
    node_command,
    quantile,
    running,
    say,
)

from impact_damper_ros.page.frames import HEADER

RATE = 200
CLIENTS = 4


async def take_frames(url: str, seconds: float) -> dict[str, Any]:
    """Be one page; return what came."""
    from tornado.websocket import websocket_connect

    page = await websocket_connect(url)
    await page.write_message(json.dumps({'type': 'view', 'window': 30.0, 'rate': 60}))
    latencies, sizes, texts = [], [], 0
    begin = time.monotonic() + WARM_UP_S
    while (now := time.monotonic()) < begin + seconds:
        content = await page.read_message()
        if now < begin or content is None:
            continue
        if isinstance(content, bytes):
            *_, epoch = HEADER.unpack_from(content)
            latencies.append(time.time() - epoch)
            sizes.append(len(content))
        else:
            texts += len(content)
    page.close()
    return {'latencies': latencies, 'sizes': sizes, 'text_bytes': texts}


def be_clients(url: str, count: int, seconds: float) -> None:
    """Be some pages, and print what came."""

    async def work() -> list[dict[str, Any]]:
        return await asyncio.gather(*(take_frames(url, seconds) for _ in range(count)))

    print(json.dumps(asyncio.run(work())))


@contextmanager
def clients(port: int, count: int, seconds: float) -> Iterator[Any]:
    """Start clients; yield what returns what they got."""
    if not count:
        yield list
        return
    url = f'ws://127.0.0.1:{port}/ws'
    process = subprocess.Popen(
        [sys.executable, __file__, '--clients', str(count), '--url', url, str(seconds)],
        stdout=subprocess.PIPE,
        text=True,
    )

    def results() -> list[dict[str, Any]]:
        output, _ = process.communicate(timeout=seconds + DEADLINE_S)
        found: list[dict[str, Any]] = json.loads(output)
        return found

    try:
        yield results
    finally:
        process.kill()
        process.communicate()


@contextmanager
def server(directory: str) -> Iterator[tuple[int, int]]:
    """Start the server; yield its process number and port."""
    log = Path(directory, 'page.txt')
    with log.open('w') as output:
        process = subprocess.Popen(
            [
                *(sys.executable, '-m', 'impact_damper_ros.cli.rig_page', '--port', '0'),
                *('--node', '/sim_node', '--recordings', directory),
            ],
            stdout=output,
        )
    try:
        end = time.monotonic() + DEADLINE_S
        while not (found := re.search(r':(\d+)/', log.read_text())):
            if time.monotonic() > end or process.poll() is not None:
                raise SystemExit('the server does not start')
            time.sleep(0.05)
        yield process.pid, int(found[1])
    finally:
        process.terminate()
        process.wait(DEADLINE_S)


@contextmanager
def stalled(port: int) -> Iterator[None]:
    """Be a page that never reads."""
    with socket.create_connection(('127.0.0.1', port)) as page:
        page.sendall(
            f'GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n'
            'Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n'
            'Sec-WebSocket-Version: 13\r\n\r\n'.encode()
        )
        yield


def measure_server(seconds: float, directory: str) -> list[dict[str, Any]]:
    """Return CPU, bytes and latency with so many clients."""
    rows = []
    with running(node_command(RATE)), server(directory) as (pid, port):
        for count in (1, CLIENTS):
            with clients(port, count, seconds) as results:
                # Until the theory of the rig is done, and all are in
                time.sleep(WARM_UP_S + 1.0)
                before, began = cpu_seconds(pid), time.monotonic()
                time.sleep(0.8 * seconds)
                cpu = (cpu_seconds(pid) - before) / (time.monotonic() - began)
                found = results()
            latencies = sorted(value for one in found for value in one['latencies'])
            sizes = [size for one in found for size in one['sizes']]
            rows.append(
                {
                    'clients': count,
                    'cpu_percent': 100 * cpu,
                    'frames_per_second': len(sizes) / count / seconds,
                    'bytes_per_frame': sum(sizes) / max(len(sizes), 1),
                    'text_bytes_per_second': sum(o['text_bytes'] for o in found) / count / seconds,
                    'latency_median_ms': 1e3 * quantile(latencies, 0.5),
                    'latency_p99_ms': 1e3 * quantile(latencies, 0.99),
                }
            )
            say(f'  {count} clients: done')
    return rows


def measure_node(seconds: float, rounds: int, directory: str) -> list[dict[str, Any]]:
    """Return what the node feels of four clients, in turns with none."""
    listener = Listener()
    kinds: dict[str, list[dict[str, float]]] = {'without': [], 'with': []}
    for number in range(rounds):
        for kind, found in kinds.items():
            listener.until_alone()
            began_ns = time.time_ns()
            with running(node_command(RATE, real_time_priority=2)) as node:
                listener.first(node, began_ns)
                if kind == 'with':
                    with server(directory) as (_, port), clients(port, CLIENTS, seconds + 4.0):
                        found.append(node_row(listener, node.pid, seconds))
                else:
                    found.append(node_row(listener, node.pid, seconds))
        say(f'  node, round {number + 1} of {rounds}: done')
    return [
        {'page': kind, **{key: sorted(r[key] for r in found)[len(found) // 2] for key in found[0]}}
        for kind, found in kinds.items()
    ]


def node_row(listener: Listener, pid: int, seconds: float) -> dict[str, float]:
    listener.listen(WARM_UP_S + 2.0)
    before, began = cpu_seconds(pid), time.monotonic()
    arrivals = listener.listen(seconds)
    cpu = (cpu_seconds(pid) - before) / (time.monotonic() - began)
    off = deviations(arrivals, RATE)
    return {
        'cpu_percent': 100 * cpu,
        'period_error_median_us': quantile(off, 0.5),
        'period_error_p99_us': quantile(off, 0.99),
        'lost': arrivals[-1].number - arrivals[0].number + 1 - len(arrivals),
    }


def measure_memory(seconds: float, directory: str) -> list[dict[str, float]]:
    """Return the memory of the server in time, with a client that never reads."""
    rows = []
    with (
        running(node_command(RATE)),
        server(directory) as (pid, port),
        clients(port, 1, seconds),
        stalled(port),
    ):
        began = time.monotonic()
        for share in range(11):
            time.sleep(max(0.0, began + 5.0 + share * (seconds - 5.0) / 10 - time.monotonic()))
            rows.append({'seconds': time.monotonic() - began, 'mib': anonymous_kib(pid) / 1024})
    return rows


async def turn_knob(url: str, count: int, pause: float) -> list[dict[str, float]]:
    """Be a page on which the gap is turned; return how long after each value its theory came."""
    from tornado.websocket import websocket_connect

    page = await websocket_connect(url)
    gap, rows = 0.024, list[dict[str, float]]()

    async def answered(began: float) -> dict[str, float]:
        times: dict[str, float] = {}
        while len(times) < 3:
            content = await page.read_message()
            if not isinstance(content, str):
                continue
            message = json.loads(content)
            now = time.monotonic() - began
            reach = max(map(abs, message.get('y', [0.0])))
            if message['type'] == 'orbit' and abs(2.0 * reach / gap - 1.0) < 1e-4:
                times.setdefault('orbit', now)
                if message['complete']:
                    times.setdefault('all', now)
            if message['type'] == 'gap_curve' and message.get('gap') == gap:
                times.setdefault('curve', now)
            if pause < 0.2 and {'orbit', 'curve'} <= set(times):
                break
        return times

    for k in range(1, count + 2):
        gap = round(0.024 + 0.004 * ((k * 0.37) % 1.0) + 1e-5 * pause, 6)
        began = time.monotonic()
        await page.write_message(json.dumps({'type': 'set', 'id': k, 'values': {'gap': gap}}))
        rows.append(await answered(began))
        await asyncio.sleep(max(0.0, pause - (time.monotonic() - began)))
    page.close()
    # With the first one, the solvers were loaded.
    return rows[1:]


def measure_theory(count: int) -> list[dict[str, Any]]:
    """Return how long after a value of the gap its theory is at a page, medians and 95 %, ms."""
    rows = []
    with (
        tempfile.TemporaryDirectory() as directory,
        running(node_command(RATE)),
        server(directory) as (_, port),
    ):
        for title, pause in (('one value a second', 1.0), ('10 values a second', 0.1)):
            found = asyncio.run(turn_knob(f'ws://127.0.0.1:{port}/ws', count, pause))
            row: dict[str, Any] = {'knob': title}
            for name in found[0]:
                times = sorted(1e3 * one[name] for one in found if name in one)
                row |= {name: quantile(times, 0.5), f'{name}, 95 %': quantile(times, 0.95)}
            rows.append(row)
    return rows


MEMORY = 'Memory of the server with a client that never reads'


def table(title: str, rows: list[dict[str, Any]]) -> str:
    names = list(rows[0])
    cells = [[f'{v:.4g}' if isinstance(v, float) else str(v) for v in r.values()] for r in rows]
    lines = [f'| {" | ".join(line)} |' for line in (names, ['---'] * len(names), *cells)]
    return '\n'.join([title, '', *lines, ''])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, add_help=True)
    parser.add_argument('--quick', action='store_true', help='a minute in all')
    parser.add_argument('--theory', action='store_true', help='only the theory')
    parser.add_argument('--memory', type=float, metavar='MINUTES', help='only the memory')
    parser.add_argument('--json', type=Path, metavar='FILE')
    parser.add_argument('--clients', type=int, help=argparse.SUPPRESS)
    parser.add_argument('--url', nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.clients:
        be_clients(arguments.url[0], arguments.clients, float(arguments.url[1]))
        return
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 101))
    if (Path(sys.prefix) / 'share' / 'ament_index').is_dir():
        os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)
    if arguments.theory:
        print(table('Theory after a value, ms', measure_theory(60)))
        return
    seconds, rounds = (8.0, 1) if arguments.quick else (30.0, 5)
    rclpy.init(args=[])
    if arguments.memory:
        with tempfile.TemporaryDirectory() as directory:
            rows = measure_memory(60.0 * arguments.memory, directory)
        print(table(MEMORY, rows))
        return
    with tempfile.TemporaryDirectory() as directory:
        found = {
            'server': measure_server(seconds, directory),
            'node': measure_node(seconds, rounds, directory),
            'theory': measure_theory(10 if arguments.quick else 60),
            'memory': measure_memory(3 * seconds, directory),
        }
    rclpy.try_shutdown()
    print(
        table(
            'Server, 60 frames per second of a rig with 200 joint states per second',
            found['server'],
        )
    )
    print(table(f'Node, with and without {CLIENTS} clients', found['node']))
    print(table('Theory after a value, ms', found['theory']))
    print(table(MEMORY, found['memory']))
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1))


if __name__ == '__main__':
    main()
