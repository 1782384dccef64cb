"""Trajectories as SLAM benchmarks store them: TUM, KITTI and EuRoC."""
