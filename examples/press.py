"""Press on a surface with 10 N for 2 s, and go back, also in trouble; see docs/examples.md."""

import signal
from time import monotonic

import rclpy
from geometry_msgs.msg import Point, Pose, PoseStamped, WrenchStamped
from rclpy.qos import qos_profile_sensor_data

FORCE, TOUCHES, LOST, STIFFNESS, GAIN = 10.0, 1.0, 0.5, 1000.0, 0.001  # [N], [N/m], [m/(N s)]
RATE, SPEED, FAR, HOLD, SILENCE, LONGEST = 20.0, 0.01, 0.1, 2.0, 0.5, 20.0  # [Hz], [m/s], [m], [s]
rclpy.init(signal_handler_options=rclpy.SignalHandlerOptions.NO)  # Ctrl-C is met here
node, poses, felt, interrupts = rclpy.create_node("press"), [], [(-1.0, 0.0, 0.0)], []


def feel(msg: WrenchStamped) -> None:
    """Keep the stamp [s], the force [N] on the sensor along z and the receipt [s], if it is new."""
    if (t := msg.header.stamp.sec + 1e-9 * msg.header.stamp.nanosec) > felt[-1][0]:
        felt.append((t, msg.wrench.force.z, monotonic()))


def force() -> float:
    """Return the mean force [N] over 1 / RATE from now on, by the stamps."""
    del felt[:-1]
    while felt[-1][0] - felt[0][0] < 1 / RATE:
        rclpy.spin_once(node, timeout_sec=0.1)
        if interrupts or monotonic() - felt[-1][2] > SILENCE:
            raise SystemExit(f"{'interrupted' if interrupts else 'no wrench comes'}: gone back")
    return sum(z for _, z, _ in felt) / len(felt)


node.create_subscription(PoseStamped, "impedance_control/pose", poses.append, 10)
node.create_subscription(WrenchStamped, "wrench", feel, qos_profile_sensor_data)
target = node.create_publisher(PoseStamped, "target_pose", 10)
while not (poses and len(felt) > 1 and target.get_subscription_count()):
    rclpy.spin_once(node, timeout_sec=0.1)
signal.signal(signal.SIGINT, lambda *_: interrupts.append(True))  # no exception inside a callback
start, depth, deepest, held, touches, recent = poses[-1], 0.0, FAR, 0.0, False, []
p, q = start.pose.position, start.pose.orientation
x, y, z = 2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x), 1 - 2 * (q.x**2 + q.y**2)
try:
    free, end = force(), felt[-1][0] + LONGEST
    while held < HOLD:
        recent.append(pressing := free - force())
        if not touches and pressing > TOUCHES:
            touches, deepest = True, depth + 3 * FORCE / STIFFNESS
            print(f"contact after {1e3 * depth:.0f} mm", flush=True)
        if pressing < -TOUCHES or (touches and max(recent[-5:]) < LOST):  # a bounce is no loss
            raise SystemExit(f"{'contact is lost' if touches else 'the sign is wrong'}: gone back")
        if felt[-1][0] > end or (depth >= FAR and not touches):
            raise SystemExit(f"{'never steady' if touches else 'nothing is there'}: gone back")
        depth = min(depth + (GAIN * (FORCE - pressing) if touches else SPEED) / RATE, deepest)
        mean = sum(recent[-10:]) / 10  # over 0.5 s
        held = held + 1 / RATE if abs(mean - FORCE) < 0.01 * FORCE else 0.0
        at = Point(x=p.x + depth * x, y=p.y + depth * y, z=p.z + depth * z)
        target.publish(PoseStamped(header=start.header, pose=Pose(position=at, orientation=q)))
    print(f"the tip pressed {mean:.2f} N")
finally:
    target.publish(start)  # the controller goes back smoothly, and stays there
    target.wait_for_all_acked()
