"""What every room may know of a car: its declared parameters, its route, and the record of a trip.

Conventions, stated once for the whole project
----------------------------------------------
World: local north, east, altitude (up) in metres about an origin; *down* D = -altitude.
Heading psi: rad, 0 = north, clockwise (to the right) positive. Pitch theta: rad, nose up positive.
Body axes: x forward, y left, z up (right-handed).
Straightness S_j = d(psi)/ds, positive in a right-hand bend; S_k = d(theta)/ds, positive in a dip, rad/m.
An accelerometer reads specific force:
    a_x =  dv/dt + g sin(theta),   a_y = -S_j v^2 (roll neglected),   a_z = g cos(theta) + S_k v^2.
Units are SI; angles rad; engine speed rad/s; torque N m; fuel power W.
(Seed 004 eqs. 1.5 to 1.9 mix two conventions; ERRATA asks for one.)
"""
