"""Simulates traffic with the roads and vehicles of highway-env, without its environments.

``package`` checks that highway-env is there, ``styles`` holds the driving styles, ``roads`` the scenarios, ``vehicles``
the vehicle class of a style, ``traffic`` one run of a scenario, and ``runs`` many runs on several processes. All
modules but ``package`` and ``styles`` import highway-env.
"""
