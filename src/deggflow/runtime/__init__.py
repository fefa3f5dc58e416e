"""Every agent its own process: each computes its own input from states, and survivors agree on who was lost."""

from .agent import Agent, TeamGeneration
from .agreement import (
    DisagreementError,
    SuspectedError,
    TeamError,
    TooManyLostError,
)
from .exchange import Exchange
from .links import TransportName, loopback_addresses, open_transport, sorted_by
from .member import Member
from .messages import AgentMessage, Layout
from .part import Neighbourhood, PartProgram
from .part_process import PartStart, compile_part, owners_of, run_part
from .process import RoundStatistics, Timing, compile_agent, run_agent
from .program import Start, TeamProgram
from .simulation import Fault, Network, Outcome, Simulation
from .transport import DirectTransport, Transport, UdpTransport, free_addresses
from .zenoh_transport import ZenohTransport

__all__ = [
    "Agent",
    "AgentMessage",
    "DirectTransport",
    "DisagreementError",
    "Exchange",
    "Fault",
    "Layout",
    "Member",
    "Neighbourhood",
    "Network",
    "Outcome",
    "PartProgram",
    "PartStart",
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
    "compile_part",
    "free_addresses",
    "loopback_addresses",
    "open_transport",
    "owners_of",
    "run_agent",
    "run_part",
    "sorted_by",
]
