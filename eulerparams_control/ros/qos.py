"""Quality of service of the topics: reliable; volatile, but for what is latched."""

from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

QOS = QoSProfile(depth=10)  # reliable, volatile
QOS_STREAM = QoSProfile(depth=1000)  # what publishers keep for readers that lag, a recorder say
QOS_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
QOS_OVERRIDES = QoSOverridingOptions(
    (
        *(QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH),
        *(QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY),
    )
)
"""The parameters by which the QoS of every input can be changed at the start of a node."""
