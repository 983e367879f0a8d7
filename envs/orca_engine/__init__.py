"""ORCA for many scenes at once: the simulator of the style-shift domain.

Optimal reciprocal collision avoidance of van den Berg, Guy, Lin and Manocha, "Reciprocal n-body collision
avoidance" (2011), in loops that numba compiles at their first call (seconds; the machine code is kept for later
processes). When agents meet almost head on, small differences decide the side on which they pass. Therefore the state
is float32, and the arithmetic is that of the RVO2 library, operation by operation: on machines without fused
multiply-add, results are bit-identical to RVO2.

``simulation`` holds the interface, ``crowd`` the steps of a scene, ``linear_program`` the choice of a velocity, and
``vectors`` their common operations.
"""
