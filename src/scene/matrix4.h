/* 4x4 affine matrices in double, column major as glTF writes them: element (row, column) is
 * m[4 * column + row], and the last row is 0 0 0 1. */
#ifndef KL_SRC_SCENE_MATRIX4_H
#define KL_SRC_SCENE_MATRIX4_H

#include <math.h>
#include <stddef.h>

static inline void kl_mat4_identity(double out[16])
{
    for (int i = 0; i < 16; ++i) {
        out[i] = i % 5 == 0 ? 1.0 : 0.0;
    }
}

/* out = a b; out is neither of them. */
static inline void kl_mat4_multiply(const double a[16], const double b[16], double out[16])
{
    for (int column = 0; column < 4; ++column) {
        for (int row = 0; row < 4; ++row) {
            double sum = 0.0;
            for (int k = 0; k < 4; ++k) {
                sum += a[4 * k + row] * b[4 * column + k];
            }
            out[4 * column + row] = sum;
        }
    }
}

/* Rotation by the unit quaternion q = (x, y, z, w), then the translation; the scale comes first. */
static inline void kl_mat4_from_trs(const double t[3], const double q[4], const double s[3],
                                    double out[16])
{
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    const double rotation[9] = {
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w),       2.0 * (x * z - y * w),
        2.0 * (x * y - z * w),       1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w),
        2.0 * (x * z + y * w),       2.0 * (y * z - x * w),       1.0 - 2.0 * (x * x + y * y)};

    for (int column = 0; column < 3; ++column) {
        for (int row = 0; row < 3; ++row) {
            out[4 * column + row] = rotation[3 * column + row] * s[column];
        }
        out[4 * column + 3] = 0.0;
        out[12 + column] = t[column];
    }
    out[15] = 1.0;
}

static inline void kl_mat4_point(const double m[16], const double p[3], double out[3])
{
    for (int row = 0; row < 3; ++row) {
        out[row] = m[row] * p[0] + m[4 + row] * p[1] + m[8 + row] * p[2] + m[12 + row];
    }
}

static inline void kl_mat4_vector(const double m[16], const double v[3], double out[3])
{
    for (int row = 0; row < 3; ++row) {
        out[row] = m[row] * v[0] + m[4 + row] * v[1] + m[8 + row] * v[2];
    }
}

/* Cofactors of the upper 3x3: det * inverse transpose. Maps normals for any matrix, singular ones
 * too; for a mirrored one the sign is that of the determinant, which is returned. */
static inline double kl_mat4_cofactors(const double m[16], double out[9])
{
    for (size_t column = 0; column < 3; ++column) {
        const double *a = &m[4 * ((column + 1) % 3)];
        const double *b = &m[4 * ((column + 2) % 3)];
        out[3 * column] = a[1] * b[2] - a[2] * b[1];
        out[3 * column + 1] = a[2] * b[0] - a[0] * b[2];
        out[3 * column + 2] = a[0] * b[1] - a[1] * b[0];
    }
    return m[0] * out[0] + m[1] * out[1] + m[2] * out[2];
}

#endif
