"""ORCA for many scenes at once: the simulator of the style-shift domain.

Optimal reciprocal collision avoidance of van den Berg, Guy, Lin and Manocha, "Reciprocal n-body collision
avoidance" (2011), in numpy over all scenes and agents of a batch. When agents meet almost head on, small differences
decide the side on which they pass. Therefore the state is float32, and the arithmetic is that of the RVO2 library,
operation by operation: on machines without fused multiply-add, results are bit-identical to RVO2.

``simulation`` holds the interface, ``crowd`` one step of a batch, ``linear_program`` the choice of a velocity, and
``vectors`` their common operations.
"""
