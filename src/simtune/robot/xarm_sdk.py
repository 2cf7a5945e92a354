"""Opens the xArm SDK without its printed output and its changes of global state."""

import contextlib
import io
import logging
import socket
import threading
from typing import Any

from simtune.errors import InputError, RobotError

_FIRST_REPORT_S = 3.0
_ANSWER_S = 0.1  # a controller that takes longer counts as not answering


def open_arm(ip: str, *, reports: bool = True) -> Any:
    """A connected `XArmAPI`; with `reports`, the first report has arrived.

    Raises InputError if the SDK is missing, RobotError if no controller answers.
    """
    # The SDK prints to stdout on import, when connecting, and from a thread soon after.
    default_s = socket.getdefaulttimeout()
    with contextlib.redirect_stdout(io.StringIO()):
        try:
            from xarm.core.utils.log import logger, origin_logger
            from xarm.wrapper import XArmAPI
        except ImportError:
            raise InputError("an xArm needs its SDK: pip install xarm-python-sdk") from None
        for talkative in (logger, origin_logger):
            talkative.setLevel(logging.CRITICAL)
        try:
            # forbid_uds: otherwise another user's socket file in /tmp could impersonate the arm.
            arm = XArmAPI(ip, do_not_open=True, enable_report=reports, forbid_uds=True)
            reported = threading.Event()
            arm.register_report_callback(lambda _: reported.set())
            arm.connect()
        except Exception as error:  # the SDK raises nothing more specific
            raise RobotError(f"no xArm answers at {ip}: {error}") from None
        finally:
            socket.setdefaulttimeout(default_s)  # the SDK sets one second for the whole process
        arm.set_timeout(_ANSWER_S)
        if reports and not reported.wait(_FIRST_REPORT_S):
            arm.disconnect()
            raise RobotError(f"the controller at {ip} sends no reports")
    return arm
