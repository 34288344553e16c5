"""Commands that speak to a running node over ROS 2: ``move``, ``status``, ``enable``, ``stop``, ``call`` and
``watch``."""
