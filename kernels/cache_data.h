/* Irradiance records and their index: the same bytes on disk, on the host and on devices.
 * Everything is little-endian 4-byte scalars (or pairs of 16-bit ones) in 64-byte aligned arrays.
 *
 * A record is split in two: the hot half decides whether it contributes to a query, the cold half
 * says what it contributes. Directions are in the record's own frame: kl_frame_from_normal of the
 * decoded normal. */
#ifndef KL_KERNELS_CACHE_DATA_H
#define KL_KERNELS_CACHE_DATA_H
#include "kernels/vec.h"

#define KL_CACHE_LEVELS 2  /* 0: seen from the camera; 1: seen by gather rays */
#define KL_SECTORS      12 /* azimuths of the leak test */

typedef struct kl_record_hot {
    float pos[3];  /* [m], render space */
    kl_u32 normal; /* octahedral, 2 x 16 bit: kl_oct_decode */
    float radius;  /* [m] distance at which the weight becomes 0 (minor axis), > 0; clamped */
    float radius2; /* [m] along the major axis, >= radius */
    kl_u32 form;   /* bits 0-11: angle of the minor axis in the frame, 4096 = pi; 12-19: raw
                    * radius2 over raw radius, 0 = 1, 255 = 2; 20-23: bounce level; 24-27: log4 of
                    * the gather rays */
    kl_u32 object; /* scene instance the record rides on, KL_NONE: static world */
} kl_record_hot;
KL_ASSERT_SIZE(kl_record_hot, 32);

typedef struct kl_record_cold {
    float irr[3];     /* irradiance [W m^-2], linear Rec. 709, >= 0 */
    kl_u16 grad[12];  /* half, pairs of components along t and b for RGB: translational gradients
                       * times raw_radius over irr, then rotational ones over irr */
    float raw_radius; /* [m] before clamping, > 0 */
    kl_u32 error_spacing; /* low 16: half, relative standard error of irr; high 16: half, least
                           * radius over raw_radius (pixel size where it was placed) */
    kl_u8 clearance[KL_SECTORS]; /* distance at which the horizon is blocked, per azimuth, as
                                  * kl_clearance_code; 255: open */
    kl_u32 touched[2];           /* set of the scene objects that E depends on: bit per bucket */
} kl_record_cold;
KL_ASSERT_SIZE(kl_record_cold, 64);

KL_FN float kl_record_axis_angle(kl_u32 form)
{
    return (float)(form & 0xfffu) * (KL_PI / 4096.0f);
}
KL_FN float kl_record_axis_ratio(kl_u32 form)
{
    return 1.0f + (float)((form >> 12) & 0xffu) * (1.0f / 255.0f);
}
KL_FN kl_u32 kl_record_level(kl_u32 form)
{
    return (form >> 20) & 0xfu;
}

/* Index of one bounce level: an octree whose leaves list what may serve a point in them, so that a
 * query goes down once and reads one row. A record lies in every leaf that its disc touches. Where
 * records of several directions meet, a node divides by the face of the direction cube instead.
 * `nodes` begins with a grid of 8^top_bits entries, z-major, then has groups of eight: the octants
 * (x + 2 y + 4 z) or the faces (2 axis + sign) of a cell. An entry is KL_NODE_EMPTY, a leaf's row,
 * or the first of another group, which lies further on. A row ends with its first marked item. */
#define KL_TOP_BITS_MAX     5u
#define KL_NODE_EMPTY       0u
#define KL_NODE_LEAF        0x80000000u /* the rest is where the row begins */
#define KL_NODE_FACES       0x40000000u /* the group divides by faces, else by octants */
#define KL_NODE_INDEX       0x3fffffffu
#define KL_ROW_LAST         0x80000000u /* the rest is a record's number */
#define KL_ROW_MAX          64          /* records of a row; more do not serve a point better */
#define KL_OCTREE_MAX_LEVEL 17u         /* cells are not smaller than 2^-17 of the root's edge */

typedef struct kl_octree_header {
    float root_min[3]; /* [m], render space */
    float side;        /* [m] edge of the root cube, a power of two */
    kl_u32 top_bits;   /* the grid that nodes begin with has 2^top_bits cells along an edge */
    kl_u32 node_count; /* entries in nodes */
    kl_u32 row_size;   /* entries in rows */
    kl_u32 record_count;
    float reach;    /* radii were enlarged by this factor when the cells were filled */
    float accuracy; /* radius over raw radius that the records' radii were made with */
    float cos_max;  /* largest angle between normals that queries allow: its cosine */
    kl_u32 pad[5];
} kl_octree_header;
KL_ASSERT_SIZE(kl_octree_header, 64);

/* One level as queries see it. Not shared bytes. */
typedef struct kl_level_view {
    kl_octree_header head; /* record_count 0: nothing here */
    const KL_GLOBAL kl_record_hot *hot;
    const KL_GLOBAL kl_record_cold *cold;
    const KL_GLOBAL kl_u32 *nodes;
    const KL_GLOBAL kl_u32 *rows;
#if !KL_DEVICE
    kl_u8 *used; /* a byte a record, 1 once it has served; NULL: nobody asks */
#endif
} kl_level_view;

/* Record i has served. Many threads may say so at once. */
#if KL_DEVICE
#define KL_NOTE_USE(view, i)
#else
static inline void kl_level_note_use(const kl_level_view *view, kl_u32 i)
{
    if (view->used == 0 || __atomic_load_n(&view->used[i], __ATOMIC_RELAXED) != 0) return;
    __atomic_store_n(&view->used[i], (kl_u8)1, __ATOMIC_RELAXED);
}
#define KL_NOTE_USE(view, i) kl_level_note_use(view, i)
#endif

#if !KL_DEVICE
/* All arrays of one level, borrowed: from a store (mapped, not copied) or from a cache. */
struct kl_level_arrays {
    kl_u32 record_count;
    const kl_record_hot *hot;
    const kl_record_cold *cold;
    kl_octree_header octree; /* record_count 0 in it: not indexed */
    const kl_u32 *nodes;     /* octree.node_count */
    const kl_u32 *rows;      /* octree.row_size */
};
#endif

#endif
