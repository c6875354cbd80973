/* pose.h - rigid motions as six numbers: rotation vector w, translation t; X' = R(w) X + t. */
#ifndef REC_CALIB_POSE_H
#define REC_CALIB_POSE_H

/* Rodrigues' formula and its inverse (|w| <= pi).  R [9] row major. */
void rec_rotation(const double w[3], double R[9]);
void rec_rotation_log(const double R[9], double w[3]);
/* R, and J [9] with R(w + dw) = R(J dw) R(w) to first order (left Jacobian of SO(3)). */
void rec_rotation_left(const double w[3], double R[9], double J[9]);

void rec_pose_mul(const double a[6], const double b[6], double out[6]); /* first b, then a */
void rec_pose_inverse(const double a[6], double out[6]);
void rec_pose_apply(const double a[6], const double X[3], double out[3]);
/* |t_a - t_b| + reach * angle between them [m]. */
double rec_pose_distance(const double a[6], const double b[6], double reach);

/* out = A B of 3x3 matrices, row major; out must be neither A nor B. */
void rec_mat3(const double A[9], const double B[9], double out[9]);

/* The rigid motion that takes points a [n][3] to b [n][3] with the least sum of weight[i] |.|^2: Horn, JOSA A
 * 4:629, 1987.  scale: size of b over size of a; may be NULL. */
void rec_pose_align(const double (*a)[3], const double (*b)[3], const double *weight, int n,
                    double out[6], double *scale);

#endif
