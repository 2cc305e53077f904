// SPDX-License-Identifier: GPL-2.0-or-later
// Written for these tests from the documented formula; compiled against LinuxCNC's headers, no part of the library.
component matrixkins "Stand-in for LinuxCNC's matrixkins where a package does not hold it: joint = C * axis, nine numbers";
pin out bit dummy=1;
license "GPL";
;;
#include "kinematics.h"

static struct { hal_float_t c[3][3]; } *data;

static int make_parameters(void) {
    static const char letter[] = "xyz";
    int bad = hal_set_unready(comp_id), i, j;
    data = hal_malloc(sizeof *data);
    if (bad || !data) return -1;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            data->c[i][j] = i == j;
            bad |= hal_param_float_newf(HAL_RW, &data->c[i][j], comp_id, "matrixkins.C_%c%c", letter[i], letter[j]);
        }
    return bad | hal_ready(comp_id);
}

KINS_NOT_SWITCHABLE
EXPORT_SYMBOL(kinematicsType);
EXPORT_SYMBOL(kinematicsInverse);
EXPORT_SYMBOL(kinematicsForward);

KINEMATICS_TYPE kinematicsType(void) {
    static int called;
    if (!called++) make_parameters();
    return KINEMATICS_BOTH;
}

// joints from axes: the matrix
int kinematicsInverse(const EmcPose *pose, double *joint, const KINEMATICS_INVERSE_FLAGS *inverse, KINEMATICS_FORWARD_FLAGS *forward) {
    const double axis[3] = {pose->tran.x, pose->tran.y, pose->tran.z};
    int i;
    (void)inverse; (void)forward;
    for (i = 0; i < 3; i++) joint[i] = data->c[i][0] * axis[0] + data->c[i][1] * axis[1] + data->c[i][2] * axis[2];
    joint[3] = pose->a; joint[4] = pose->b; joint[5] = pose->c; joint[6] = pose->u; joint[7] = pose->v; joint[8] = pose->w;
    return 0;
}

// axes from joints: Cramer's rule, with the joints in place of one column after the other
static double determinant(const double m[3][3]) {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
         + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

static double with_joints(const double *joint, int column) {
    double m[3][3];
    int i, j;
    for (i = 0; i < 3; i++) for (j = 0; j < 3; j++) m[i][j] = j == column ? joint[i] : data->c[i][j];
    return determinant(m);
}

int kinematicsForward(const double *joint, EmcPose *pose, const KINEMATICS_FORWARD_FLAGS *forward, KINEMATICS_INVERSE_FLAGS *inverse) {
    const double nothing[3] = {0, 0, 0}, whole = with_joints(nothing, -1);
    (void)inverse; (void)forward;
    pose->tran.x = with_joints(joint, 0) / whole;
    pose->tran.y = with_joints(joint, 1) / whole;
    pose->tran.z = with_joints(joint, 2) / whole;
    pose->a = joint[3]; pose->b = joint[4]; pose->c = joint[5]; pose->u = joint[6]; pose->v = joint[7]; pose->w = joint[8];
    return 0;
}
