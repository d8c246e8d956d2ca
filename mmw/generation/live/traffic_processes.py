"""Run the traffic of several worlds in worker processes, each with the engines of some of them."""

import multiprocessing
import os
import pickle
import weakref
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from multiprocessing.connection import Connection
from typing import Protocol

import numpy as np

from mmw.core.bvh_kind import kind_to_build, select_bvh
from mmw.core.cpu_cores import cores
from mmw.core.device import start_warp
from mmw.core.errors import Error, InputError
from mmw.generation.executors.child_process import ChildProcess, WorkerDiedError, picklable_error
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.live.live_traffic import LiveTraffic
from mmw.traffic.live.vehicle_server import (
    Answer,
    Begun,
    Call,
    Driven,
    Resume,
    Resumed,
    ServedTraffic,
    ServedVehicles,
    Start,
    VehicleServer,
)

WORLDS_PER_PROCESS = 4
"""Least number of worlds for which one more process pays off. A decision of 20 drivers takes 0.4 ms and more, a message
and its answer 0.1 to 0.2 ms. Design value."""


def process_count(worlds: int) -> int:
    """Return in how many processes the traffic of worlds runs, 0 for this one: one a core, if each has worlds."""
    number = 0 if is_daemon() else min(cores(), worlds // WORLDS_PER_PROCESS)
    return number if number > 1 else 0


def is_daemon() -> bool:
    """Return whether `multiprocessing` made this process as a daemon, which may start none, as workers often are."""
    return multiprocessing.current_process().daemon


class TrafficLostError(Error, RuntimeError):
    """Report that the traffic of a world has failed, or the process that it ran in; a reset starts it anew."""


class _Server(Protocol):
    """A `VehicleServer` somewhere."""

    def send(self, forgotten: Sequence[int], calls: Sequence[Call]) -> None:
        """Begin to make calls."""

    def receive(self) -> list[Answer]:
        """Return the answers to the calls; raises `WorkerDiedError` if the process died."""
        ...

    def close(self) -> None:
        """Let all episodes go."""


class _OwnServer:
    """A server in this process."""

    def __init__(self, demand: TrafficDemand) -> None:
        self._server = VehicleServer(demand)
        self._asked: tuple[Sequence[int], Sequence[Call]] = (), ()

    def send(self, forgotten: Sequence[int], calls: Sequence[Call]) -> None:
        self._asked = forgotten, calls

    def receive(self) -> list[Answer]:
        return self._server.answer(*self._asked)

    def close(self) -> None:
        """Change nothing: all is in Python's memory."""


class _ProcessServer:
    """A server in a process of its own, which starts with the first call, and again after it has died."""

    def __init__(self, demand: bytes) -> None:
        self._demand = demand
        self._children: list[ChildProcess] = []
        self._finalizer = weakref.finalize(self, _kill, self._children)

    def send(self, forgotten: Sequence[int], calls: Sequence[Call]) -> None:
        if not self._children:
            self._children.append(ChildProcess(_serve, self._demand, kind_to_build()))
        self._children[0].send((forgotten, calls))

    def receive(self) -> list[Answer]:
        return self._children[0].receive()

    def close(self) -> None:
        _kill(self._children)


def _kill(children: list[ChildProcess]) -> None:
    while children:
        children.pop().kill()


def _serve(connection: Connection, demand: bytes, bvh: str) -> None:
    """Answer calls until the other end closes."""
    os.environ["CUDA_VISIBLE_DEVICES"] = ""  # wheels drop on the road by Warp on the CPU; the GPU is not for this
    start_warp()
    select_bvh(bvh)
    server = VehicleServer(pickle.loads(demand))
    while True:
        try:
            forgotten, calls = connection.recv()
        except EOFError:
            return
        answers = server.answer(forgotten, calls)
        connection.send([picklable_error(one) if isinstance(one, Exception) else one for one in answers])


class TrafficProcesses:
    """Traffic of the worlds of a simulation: world k runs in process k modulo their number.

    All calls name the worlds that they are for. After an error in `drive` these are lost until they start anew, and the
    rows of all worlds are where they were.
    """

    def __init__(self, name: str, demand: TrafficDemand, processes: int) -> None:
        """Start the processes when they are first needed.

        Args:
            name: Name of the simulation, in messages.
            demand: Traffic of the first world.
            processes: Number of processes; 0 for this one.
        """
        self._name = name
        if processes:
            plain = pickle.dumps(replace(demand), pickle.HIGHEST_PROTOCOL)  # without what it holds on a device
            self._servers: list[_Server] = [_ProcessServer(plain) for _ in range(processes)]
        else:
            self._servers = [_OwnServer(demand)]
        self._keys = count()
        self._held: list[dict[ServedVehicles, int]] = [{} for _ in self._servers]
        """Episodes that each server holds, and their worlds."""

    def start(self, asked: Sequence[tuple[int, TrafficDemand]], rows: int) -> list[ServedTraffic]:
        """Return the traffic of worlds at row 0, with so many rows that are known.

        Raises:
            InputError: If a demand cannot be met; the message names the world.
            TrafficLostError: If a process has died.
        """
        calls = [(world, Start(next(self._keys), demand.seed, demand.fleet, rows)) for world, demand in asked]
        answers = self._exchange(calls)
        begun = []
        for (world, call), answer in zip(calls, answers, strict=True):
            if isinstance(answer, Begun):
                vehicles = ServedVehicles(call.key, answer, partial(self._resume, world))
                self._held[world % len(self._servers)][vehicles] = world
                begun.append(ServedTraffic(vehicles, answer.people))
        try:
            self._check(calls, answers)
        except BaseException:
            for one in begun:
                one.vehicles.close()
            raise
        return begun

    def drive(self, asked: Sequence[tuple[int, ServedVehicles, LiveTraffic]]) -> None:
        """Take the next rows of worlds, whose traffic has had its controls.

        Raises:
            TrafficLostError: If an engine fails, or a process has died.
        """
        calls = [(world, vehicles.ask(traffic.rows, traffic.seen)) for world, vehicles, traffic in asked]
        try:
            answers = self._exchange(calls)
            self._check(calls, answers)
        except BaseException:
            for _, vehicles, _ in asked:
                vehicles.is_lost = True
            raise
        for (_, vehicles, _), answer in zip(asked, answers, strict=True):
            assert isinstance(answer, Driven)
            vehicles.take(answer)

    def _resume(self, world: int, call: Resume) -> np.ndarray:
        """Put a vehicle of a world back on its route; return its pose.

        Raises:
            InputError: If there is no safe place.
            TrafficLostError: If its engine fails, or its process has died.
        """
        (answer,) = self._exchange([(world, call)])
        if isinstance(answer, InputError):
            raise answer
        if not isinstance(answer, Resumed):
            for vehicles in self._held[world % len(self._servers)]:
                vehicles.is_lost |= vehicles.key == call.key
            self._check([(world, call)], [answer])
        assert isinstance(answer, Resumed)
        return answer.pose

    def check(self, world: int, vehicles: ServedVehicles) -> None:
        """Check that a world can go on.

        Raises:
            TrafficLostError: If its traffic was lost.
        """
        if vehicles.is_lost:
            raise TrafficLostError(f"{self._name}, world {world}: its traffic was lost before; reset it")

    def close(self) -> None:
        """End the processes; closing again changes nothing."""
        for server in self._servers:
            server.close()

    def _exchange(self, calls: Sequence[tuple[int, Call]]) -> list[Answer]:
        """Return the answers to calls, each of a world, in their order; all processes work at once."""
        places: dict[int, list[int]] = defaultdict(list)
        for place, (world, _) in enumerate(calls):
            places[world % len(self._servers)].append(place)
        answers: dict[int, Answer] = {}
        waiting = dict.fromkeys(places)
        try:
            for number, own in places.items():
                self._servers[number].send(self._forgotten(number), [calls[place][1] for place in own])
            for number, own in places.items():
                try:
                    found = self._servers[number].receive()
                    del waiting[number]
                except WorkerDiedError as error:
                    found = [self._death(number, [calls[place][0] for place in own], error)] * len(own)
                answers |= zip(own, found, strict=True)
        finally:
            for number in waiting:  # it died, or has an answer that nobody waits for
                self._lose(number)
        return [answers[place] for place in range(len(calls))]

    def _forgotten(self, number: int) -> list[int]:
        closed = [vehicles for vehicles in self._held[number] if vehicles.is_closed]
        for vehicles in closed:
            del self._held[number][vehicles]
        return [vehicles.key for vehicles in closed]

    def _death(self, number: int, asked: Sequence[int], cause: WorkerDiedError) -> TrafficLostError:
        held = (world for vehicles, world in self._held[number].items() if not vehicles.is_closed)
        worlds = sorted({*asked, *held})
        return TrafficLostError(
            f"{self._name}, world{'s' * (len(worlds) > 1)} {', '.join(map(str, worlds))}: the process of the traffic "
            f"died {cause}; reset these worlds, or give fewer processes if memory was short"
        )

    def _lose(self, number: int) -> None:
        """End a process, whose episodes are lost; the next call starts another one."""
        self._servers[number].close()
        for vehicles in self._held[number]:
            vehicles.is_lost = True
        self._held[number].clear()

    def _check(self, calls: Sequence[tuple[int, Call]], answers: Sequence[Answer]) -> None:
        """Raise the first error among answers, with the name of its world."""
        for (world, _), answer in zip(calls, answers, strict=True):
            where = f"{self._name}, world {world}"
            if isinstance(answer, TrafficLostError):
                raise answer
            if isinstance(answer, InputError):
                raise InputError(f"{where}: {answer}") from answer
            if isinstance(answer, Exception):
                raise TrafficLostError(
                    f"{where}: its traffic failed: {type(answer).__name__}: {answer}; reset the worlds of this call"
                ) from answer
