"""The standard deviation of a depth, as a sum of listed terms.

    std^2(x, y) = sum of the variances below, taken to be independent

    term           file                  what is not known                                vanishes where
    depth scale    depth_scale.py        the photometric scale, from ball to ball         the depth is 0
    leakage        leakage.py            slopes under a contact, felt beside it           nothing is deep nearby
    missing colour missing_colour.py     what an overexposed colour would have told        all colours are known
    slope noise    slope_noise.py        the camera's noise, integrated                   the slopes have none
    untouched gel  untouched_gel.py      slow waves that drawn noise does not show        free frames come out flat
    zero plane     zero_plane.py         where depth 0 lies                               all blocks are coplanar
    illumination   illumination.py       the drift of the light                           nothing has drifted
    steep edge     steep_edge.py         the step of an edge that was restored            no edge was restored
    steep slope    steep_slope.py        slopes steeper than any ball showed              none is steeper

`depth.py` sums them. Blur of contacts only a few pixels wide is in none of them.
`ball_validation.py` holds depths against balls that a calibration never saw; `untouched_noise.py` takes the depth
scale's term out again, for what asks only whether the gel is touched.
"""
