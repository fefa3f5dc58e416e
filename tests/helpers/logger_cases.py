"""Processes that agree on a log of rounds and losses, and compute nothing."""

from hashlib import blake2b

from deggflow.runtime.agreement import Agreement, RoundComplete
from deggflow.runtime.simulation import Network, Simulation

SIZE = 8


class Logger:
    """Its content in each round is a digest of its number and of all that was agreed on before.

    It has finished once it knows that all have the log of `rounds` rounds, as an agent has once all have the sample.
    """

    def __init__(self, number, agents, faults, rounds, deadline):
        self.agreement = Agreement(
            number, agents, team=7, size=SIZE, faults=faults, deadline=deadline, now=0.0
        )
        self.number, self.rounds = number, rounds
        self.log, self.result = [], None
        self.completed, self.past = 0, b""  # number of rounds, and a digest of the log

    def content(self):
        return blake2b(bytes([self.number]) + self.past, digest_size=SIZE).digest()

    def write(self, kind, what):
        self.log.append((kind, what))
        self.completed += kind == "round"
        self.past = blake2b(self.past + repr((kind, what)).encode(), digest_size=SIZE).digest()

    def start(self):
        self.follow(self.agreement.publish(self.content()))

    def receive(self, data, now):
        self.follow(self.agreement.receive(data, now))

    def tick(self, now):
        self.follow(self.agreement.tick(now))

    def sent(self):
        out, self.agreement.outbox = self.agreement.outbox, []
        return out

    def follow(self, events):
        while events:
            for event in events:
                if self.result is None and self.completed >= self.rounds:
                    self.result = list(self.log)
                if isinstance(event, RoundComplete):
                    self.write("round", tuple(sorted(event.contents.items())))
                else:
                    self.write("lost", tuple(sorted(event.lost)))
            events = self.agreement.publish(self.content())


def play(seed, *, agents=4, faults=1, rounds=6, network=None, plan=(), deadline=None):
    """One simulated run: the loggers, and what became of them."""
    network = network or Network()
    deadline = network.deadline if deadline is None else deadline
    team = [Logger(k, agents, faults, rounds, deadline) for k in range(agents)]
    simulation = Simulation(team, network, plan, seed)
    return team, simulation.run(lambda logger: logger.result is not None)
