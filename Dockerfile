# docker build -t eulerparams_control .
# docker run --rm -it --network host eulerparams_control ros2 launch eulerparams_control bringup.launch.py
FROM ros:jazzy
WORKDIR /ws
COPY . src/eulerparams_control
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3-pip \
 && rosdep update --rosdistro "$ROS_DISTRO" \
 && rosdep install --from-paths src --ignore-src -y --skip-keys "mcap-ros2-support python3-pybullet-pip" \
 && pip install --no-cache-dir --break-system-packages mcap-ros2-support example-robot-data ruckig pybullet-arm64 \
      plotly "pyarrow<26" meshcat viser \
 && rm -rf /var/lib/apt/lists/*
RUN . "/opt/ros/$ROS_DISTRO/setup.sh" \
 && colcon build --packages-select eulerparams_control \
 && . install/setup.sh \
 && python3 -c "import eulerparams_control.control.controller; from eulerparams_control.parameters.schemes import schemes; schemes()"
RUN sed --in-place --expression '$isource "/ws/install/setup.bash"' /ros_entrypoint.sh
CMD ["ros2", "run", "eulerparams_control", "experiment", "demo", "--out", "/tmp/out"]
