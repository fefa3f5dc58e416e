"""Experiments with the bridge (Task 1)."""

from .bridge_process import BridgeProcess
from .bridge_rescue import BridgeRescue
from .bridge_success import BridgeSuccess
from .experiment import Experiment

EXPERIMENTS: tuple[Experiment, ...] = (BridgeSuccess(), BridgeProcess(), BridgeRescue())
