"""Quality of service of the topics: reliable; volatile, but for what is latched."""

from copy import copy
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

QOS = QoSProfile(depth=10)  # reliable, volatile
QOS_STREAM = QoSProfile(depth=1000)  # what publishers keep for readers that lag, a recorder say
QOS_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_OVERRIDES = QoSOverridingOptions(
    [QoSPolicyKind[name] for name in ("HISTORY", "DEPTH", "RELIABILITY", "DURABILITY")]
)


def overridable(qos: QoSProfile) -> dict[str, Any]:
    """Return the arguments of a subscription whose QoS can be changed by parameters at its start.

    rclpy writes the parameters into the profile, which is a copy: they are those of one topic.
    """
    return {"qos_profile": copy(qos), "qos_overriding_options": _OVERRIDES}
