"""The vehicle's state estimator: an error-state Kalman filter on IMU, camera poses and body sensors.

In: IMU samples at their own rate, and measurements with covariances, in any order and with any delay. Out: pose,
velocity and biases with their covariance, at any time. Runs on the vehicle, so it depends on numpy, scipy.special and
compiled kernels only. Imports the tracker protocol and geometry kernels, no tracker.
"""
