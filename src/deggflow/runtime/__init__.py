"""Every agent its own process: each computes its own input from states, and survivors agree on who was lost."""

from .agent import Agent, TeamGeneration
from .agreement import (
    DisagreementError,
    SuspectedError,
    TeamError,
    TooManyLostError,
)
from .member import Member
from .messages import AgentMessage, Layout
from .process import RoundStatistics, Timing, run_agent
from .program import Start, TeamProgram
from .simulation import Fault, Network, Outcome, Simulation
from .transport import Transport, UdpTransport, free_addresses
from .zenoh_transport import ZenohTransport

__all__ = [
    "Agent",
    "AgentMessage",
    "DisagreementError",
    "Fault",
    "Layout",
    "Member",
    "Network",
    "Outcome",
    "RoundStatistics",
    "Simulation",
    "Start",
    "SuspectedError",
    "TeamError",
    "TeamGeneration",
    "TeamProgram",
    "Timing",
    "TooManyLostError",
    "Transport",
    "UdpTransport",
    "ZenohTransport",
    "free_addresses",
    "run_agent",
]
