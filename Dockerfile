# docker build -t eulerparams_control .
# docker run --rm -it --network host eulerparams_control ros2 launch eulerparams_control bringup.launch.py
FROM ros:jazzy
ENV PIP_BREAK_SYSTEM_PACKAGES=1
WORKDIR /ws
COPY . src/eulerparams_control
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3-dev python3-pip \
 && rosdep update --rosdistro "$ROS_DISTRO" \
 && rosdep install --from-paths src --ignore-src -y \
 && pip install --no-cache-dir example-robot-data ruckig plotly pyarrow meshcat pycollada viser "dask[distributed]" \
 && rm -rf /var/lib/apt/lists/*
RUN . "/opt/ros/$ROS_DISTRO/setup.sh" \
 && colcon build --packages-select eulerparams_control \
 && . install/setup.sh \
 && ros2 run eulerparams_control compile_laws
RUN sed --in-place --expression '$isource "/ws/install/setup.bash"' /ros_entrypoint.sh
CMD ["ros2", "run", "eulerparams_control", "experiment", "demo", "--out", "/tmp/out"]
