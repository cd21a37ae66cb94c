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
    float irr[3];         /* irradiance [W m^-2], linear Rec. 709, >= 0 */
    kl_u16 grad_t[6];     /* half: d(irr_c)/dt, d(irr_c)/db times raw_radius over irr_c, c = RGB */
    kl_u16 grad_r[6];     /* half: rotational gradient over irr_c */
    float raw_radius;     /* [m] before clamping, > 0 */
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

#define KL_DIRECTORY_BITS 5 /* the root cube has 32^3 directory cells */
#define KL_DIRECTORY_SIZE 32768

/* Index of one bounce level: a multi-level grid hashed by cell, that is a linear octree (methods:
 * Warren and Salmon, "A parallel hashed oct-tree N-body algorithm", 1993). Cell edge at level l is
 * side / 2^l. A record lies in every cell of its level that its disc touches, once for each of the
 * six faces of the direction cube that normals it may serve point to: surfaces that meet at an edge
 * do not get in each other's way.
 * A coarse directory says which levels have anything near, so that a query probes only those. */
typedef struct kl_octree_header {
    float root_min[3]; /* [m], render space */
    float side;        /* [m] edge of the root cube, a power of two */
    kl_u32 level_mask; /* bit l: some record lives on level l */
    kl_u32 slot_count; /* power of two */
    kl_u32 row_size;   /* entries in rows; the first KL_DIRECTORY_SIZE are the directory: masks
                        * of the levels with cells in or around each directory cell */
    kl_u32 record_count;
    kl_u32 salt;    /* of the cell hash, chosen so that no two cells look alike */
    float reach;    /* radii were enlarged by this factor when the cells were filled */
    float accuracy; /* radius over raw radius that the records' radii were made with */
    float cos_max;  /* ditto: largest angle between normals that queries allow */
    kl_u32 pad[4];
} kl_octree_header;
KL_ASSERT_SIZE(kl_octree_header, 64);

typedef struct kl_octree_slot {
    kl_u32 tag; /* 32 bits of the cell's hash, 0: empty */
    kl_u32 row; /* start in rows: a check word, a count, then that many record numbers */
} kl_octree_slot;
KL_ASSERT_SIZE(kl_octree_slot, 8);

/* One level as queries see it. Not shared bytes. */
typedef struct kl_level_view {
    kl_octree_header head; /* record_count 0: nothing here */
    const KL_GLOBAL kl_record_hot *hot;
    const KL_GLOBAL kl_record_cold *cold;
    const KL_GLOBAL kl_octree_slot *slots;
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
    kl_octree_header octree;     /* record_count 0 in it: not indexed */
    const kl_octree_slot *slots; /* octree.slot_count */
    const kl_u32 *rows;          /* octree.row_size */
};
#endif

#endif
