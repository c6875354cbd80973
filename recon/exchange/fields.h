/* fields.h - inside this room: what the readers share.  One tree (pvx_yaml) holds YAML, JSON, TOML and XML; TOML and XML
 * are translated to it line by line, so that messages name the line of the file. */
#ifndef EXCHANGE_FIELDS_H
#define EXCHANGE_FIELDS_H
#include "base/yaml.h"
#include "recon/exchange/exchange.h"

struct exchange_in {
    const pvx_yaml *y;
    const char *path; /* of the file */
    struct rec_exchange *x;
    struct pvx_diag *d;
};

#define EXCHANGE_MAX 16 /* numbers in a matrix */

/* YAML text with the same lines.  Owner of *out: caller, free(). */
PVX_MUST_CHECK pvx_err exchange_from_toml(const char *text, size_t len, const char *name,
                                          char **out, size_t *n, struct pvx_diag *d);
/* FileStorage (root <opencv_storage>): as its YAML.  Others: each element is [name, {attributes}, text, children...]. */
PVX_MUST_CHECK pvx_err exchange_from_xml(const char *text, size_t len, const char *name, char **out,
                                         size_t *n, struct pvx_diag *d);

/* Name of the file without folder and ending. */
void exchange_stem(const char *path, char out[REC_NAME_MAX]);
/* The camera of this name, new if there is none.  Characters that a rig does not allow become '_'. */
PVX_MUST_CHECK pvx_err exchange_camera(struct rec_exchange *x, const char *path, const char *name,
                                       struct rec_exchange_camera **out, struct pvx_diag *d);
void exchange_note(struct rec_exchange *x, const char *text);

/* n_min to n_max numbers, of a list, of a list of lists or of a FileStorage matrix, row by row. */
PVX_MUST_CHECK pvx_err exchange_numbers(const struct exchange_in *in, int node, const char *key,
                                        size_t n_min, size_t n_max, double out[EXCHANGE_MAX],
                                        size_t *n);

/* These check, and mark what the camera now has; `key` and `node` for messages (node 0: the file as a whole).
 * centre: where the format has the centre of the first pixel. */
PVX_MUST_CHECK pvx_err exchange_lens(const struct exchange_in *in, int node, const char *key,
                                     const double K[9], double centre,
                                     struct rec_exchange_camera *c);
PVX_MUST_CHECK pvx_err exchange_distortion(const struct exchange_in *in, int node, const char *key,
                                           enum rec_camera_model model, const double *k, size_t n,
                                           struct rec_exchange_camera *c);
PVX_MUST_CHECK pvx_err exchange_size(const struct exchange_in *in, int node, const char *key,
                                     const double wh[2], struct rec_exchange_camera *c);
/* World to camera. */
PVX_MUST_CHECK pvx_err exchange_pose(const struct exchange_in *in, int node, const char *key,
                                     const double R[9], const double t[3],
                                     struct rec_exchange_camera *c);
/* Camera to world: axes of the camera as columns of R, its place. */
PVX_MUST_CHECK pvx_err exchange_pose_to_world(const struct exchange_in *in, int node,
                                              const char *key, const double R[9],
                                              const double at[3], struct rec_exchange_camera *c);
PVX_MUST_CHECK pvx_err exchange_unit(const struct exchange_in *in, double metres);
/* Refusals: "file:line: key: ...". */
pvx_err exchange_fail(const struct exchange_in *in, int node, const char *key, pvx_err e,
                      const char *fmt, ...) PVX_PRINTF(5, 6);
#ifdef __clang_analyzer__ /* as pvx_fail in err.h */
#define exchange_fail(in, node, key, e, ...) (exchange_fail(in, node, key, e, __VA_ARGS__), (e))
#endif

void exchange_rodrigues(const double v[3], double R[9]);
void exchange_quaternion(const double wxyz[4], double R[9]);
void exchange_transpose(const double in[9], double out[9]);

/* Does the file look like this format's?  It is read only if so, or if the caller says so. */
bool exchange_is_ros(const pvx_yaml *y);
bool exchange_is_kalibr(const pvx_yaml *y);
bool exchange_is_anipose(const pvx_yaml *y);
bool exchange_is_agisoft(const pvx_yaml *y);
bool exchange_is_blender(const pvx_yaml *y);
bool exchange_is_jarvis(const pvx_yaml *y);
bool exchange_is_matlab(const char *text, size_t len);
bool exchange_is_colmap(const char *path);

PVX_MUST_CHECK pvx_err exchange_read_opencv(const struct exchange_in *in);
PVX_MUST_CHECK pvx_err exchange_read_ros(const struct exchange_in *in);
PVX_MUST_CHECK pvx_err exchange_read_kalibr(const struct exchange_in *in);
PVX_MUST_CHECK pvx_err exchange_read_anipose(const struct exchange_in *in);
PVX_MUST_CHECK pvx_err exchange_read_jarvis(const struct exchange_in *in);
PVX_MUST_CHECK pvx_err exchange_read_agisoft(const struct exchange_in *in);
PVX_MUST_CHECK pvx_err exchange_read_blender(const struct exchange_in *in);
PVX_MUST_CHECK pvx_err exchange_read_matlab(const struct exchange_in *in);
/* The folder's cameras and images, text or binary. */
PVX_MUST_CHECK pvx_err exchange_read_colmap(const struct exchange_in *in);
#endif
