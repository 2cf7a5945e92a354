"""The xArm SDK, opened without what it prints and without what it changes for everybody else."""

import contextlib
import io
import logging
import socket
import threading
from typing import Any

from simtune.errors import InputError, RobotError

_FIRST_REPORT_S = 3.0
_ANSWER_S = 0.1  # a controller that takes longer is one that no longer answers


def open_arm(ip: str, *, reports: bool = True) -> Any:
    """A connected `XArmAPI`; with `reports` its first one is there.

    Raises InputError where there is no SDK, RobotError where no controller answers.
    """
    # It prints to stdout on import, when connecting, and from a thread soon after.
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
            # forbid_uds: a socket file of another user in /tmp must not stand in for the arm.
            arm = XArmAPI(ip, do_not_open=True, enable_report=reports, forbid_uds=True)
            reported = threading.Event()
            arm.register_report_callback(lambda _: reported.set())
            arm.connect()
        except Exception as error:  # the SDK raises nothing more specific
            raise RobotError(f"no xArm answers at {ip}: {error}") from None
        finally:
            socket.setdefaulttimeout(default_s)  # it sets one second for the whole process
        arm.set_timeout(_ANSWER_S)
        if reports and not reported.wait(_FIRST_REPORT_S):
            arm.disconnect()
            raise RobotError(f"the controller at {ip} sends no reports")
    return arm
