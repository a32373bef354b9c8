# ROS 2 Jazzy with this package built as README says: docker build -t tactile_dynamics_ros .
FROM ros:jazzy
SHELL ["/bin/bash", "-e", "-o", "pipefail", "-c"]

RUN useradd --create-home --shell /bin/bash robot
WORKDIR /home/robot/ws
COPY package.xml src/tactile_dynamics_ros/
COPY interfaces/package.xml src/tactile_dynamics_ros/interfaces/
RUN apt-get update \
    && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src src/tactile_dynamics_ros/interfaces --ignore-src -y \
    && rm -rf /var/lib/apt/lists/* \
    && chown -R robot .

USER robot
RUN python3 -m venv --system-site-packages .venv && touch .venv/COLCON_IGNORE
RUN source .venv/bin/activate \
    && pip install apsw backports.zstd gtsam lz4 pypcd4 rich rosbags shtab small_gicp sympy trimesh urdf-parser-py
COPY --chown=robot . src/tactile_dynamics_ros
RUN source /opt/ros/jazzy/setup.bash && source .venv/bin/activate \
    && colcon build --base-paths src src/tactile_dynamics_ros/interfaces

ENTRYPOINT ["/bin/bash", "-c", "source /opt/ros/jazzy/setup.bash && source ~/ws/.venv/bin/activate && source ~/ws/install/setup.bash && exec \"$@\"", "--"]
CMD ["tactile-dynamics", "--help"]
