"""Every agent its own process: each computes its own input from states, and survivors agree on who was lost."""

from .agent import Agent, TeamGeneration
from .agreement import (
    DisagreementError,
    SuspectedError,
    TeamError,
    TooManyLostError,
)
from .links import TransportName, loopback_addresses, open_transport, sorted_by
from .member import Member
from .messages import AgentMessage, Layout
from .process import RoundStatistics, Timing, compile_agent, run_agent
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
    "TransportName",
    "UdpTransport",
    "ZenohTransport",
    "compile_agent",
    "free_addresses",
    "loopback_addresses",
    "open_transport",
    "run_agent",
    "sorted_by",
]
