"""Where the object is: kinematic and visual trackers with believable covariances."""
