"""ORCA for many scenes at once: the simulator behind the style-shift domain.

Optimal reciprocal collision avoidance of van den Berg, Guy, Lin and Manocha, "Reciprocal n-body collision
avoidance" (2011), in numpy over all scenes and agents of a batch. Agents that meet almost head on magnify any
difference, until they pass on another side. So the state is float32 and the arithmetic that of the RVO2 library,
operation by operation: on machines without fused multiply-add the two agree to the last bit.

``simulation`` holds the interface, ``crowd`` one step of a batch, ``linear_program`` the choice of a velocity and
``vectors`` the operations that they share.
"""
