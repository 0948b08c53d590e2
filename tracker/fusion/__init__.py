"""The vehicle's state estimator: an error-state Kalman filter on IMU, camera poses and body sensors.

In: IMU samples at their own rate, and measurements with covariances, in any order and however late. Out: pose,
velocity and biases with their covariance, at any time. numpy and compiled kernels only, as it runs on the vehicle;
imports the tracker protocol and geometry kernels, no tracker.
"""
