/* Where a camera stands and looks at one instant. */
#ifndef KL_SEQUENCES_LOOK_H
#define KL_SEQUENCES_LOOK_H

struct kl_look {
    double eye[3];    /* [m] world */
    double target[3]; /* [m] world, never at the eye */
    double up[3];     /* unit, world, not along the view */
    double yfov;      /* [rad] vertical field of view; 0: the path says nothing about it */
};

#endif
