component volid_grid "Volumetric compensation: moves X, Y, Z by a grid of corrections";
description """
Adds corrections of a grid over X, Y, Z, interpolated linearly in each direction, to the commands of three joints, and takes
them out of the feedback, so that the rest of LinuxCNC does not see them. The grid is a file that
.B volid export --cnc linuxcnc-hal
writes. Beyond its nodes the value of the last node is held.

.B loadrt volid_grid names=NAME,... files=FILE,...
makes one instance for each file. Several instances form a chain: corrections of one, pins d-x, d-y, d-z, are connected with more-x,
more-y, more-z of the next; the last one moves the joints.
""";
notes """
The file is read when the component is loaded; a file that is damaged stops the start, with the reason and its line. Runs in the
uspace version of LinuxCNC, which has files. The functions belong into the thread as follows: what reads the drives, feedback,
motion-controller, command, what writes to the drives.
""";
pin in float pos_x "Commanded position of the joint, where the correction is looked up (joint.N.pos-cmd)";
pin in float pos_y;
pin in float pos_z;
pin in float motor_in_x "Command for the drive, without this correction (joint.N.motor-pos-cmd)";
pin in float motor_in_y;
pin in float motor_in_z;
pin out float motor_x "Command for the drive, with it";
pin out float motor_y;
pin out float motor_z;
pin in float drive_x "Feedback of the drive";
pin in float drive_y;
pin in float drive_z;
pin out float fb_x "Feedback without the correction (joint.N.motor-pos-fb)";
pin out float fb_y;
pin out float fb_z;
pin in float more_x "Correction by another instance, added";
pin in float more_y;
pin in float more_z;
pin out float d_x "Correction, with that of other instances";
pin out float d_y;
pin out float d_z;
pin in bit homed "Whether positions are those of the machine (motion.is-all-homed)";
pin in bit enable = TRUE "Whether to correct";
pin out float weight "Share of the correction that acts: runs from 0 to 1, and back, within fade-time";
pin out bit beyond "Whether the position lies beyond the nodes";
param rw float fade_time = 1.0 "Time in which the correction is put on and taken off, in seconds";
function command fp "Correction and commands; after motion-controller";
function feedback fp "Feedback; before motion-controller";
variable int number;
option extra_setup yes;
option extra_cleanup yes;
include "volid_grid.h";
license "GPL";
author "The authors of volid";
;;

#define MOST_FILES 16

static char *files = "";
RTAPI_MP_STRING(files, "names of the files, separated by commas, in the order of the instances");

static volid_grid grids[MOST_FILES];

/* The file of an instance, counted from 0; 0 if there is none. */
static int file_of(long instance, char *name, size_t size) {
    const char *begin = files;
    size_t length;
    for (; instance > 0 && begin; instance--) {
        begin = strchr(begin, ',');
        if (begin) begin++;
    }
    length = begin ? strcspn(begin, ",") : 0;
    if (length == 0 || length >= size) return 0;
    memcpy(name, begin, length);
    name[length] = '\0';
    return 1;
}

EXTRA_SETUP() { /* pins do not exist yet */
    char name[1024], problem[200];
    number = (int)extra_arg;
    if (extra_arg >= MOST_FILES || !file_of(extra_arg, name, sizeof name)) {
        rtapi_print_msg(RTAPI_MSG_ERR, "%s: no file; expected files=FILE,... with one for each instance\n", prefix);
        return -EINVAL;
    }
    if (!volid_read(name, &grids[extra_arg], problem)) {
        rtapi_print_msg(RTAPI_MSG_ERR, "%s: %s: %s\n", prefix, name, problem);
        return -EINVAL;
    }
    return 0;
}

EXTRA_CLEANUP() {
    for (int i = 0; i < MOST_FILES; i++) volid_free(&grids[i]);
}

FUNCTION(command) {
    const double position[3] = {pos_x, pos_y, pos_z};
    double own[3], step = fade_time > fperiod ? fperiod / fade_time : 1.0, goal = homed && enable ? 1.0 : 0.0;
    weight = weight < goal ? fmin(goal, weight + step) : fmax(goal, weight - step);
    beyond = volid_correction(&grids[number], position, own);
    d_x = weight * own[0] + more_x;
    d_y = weight * own[1] + more_y;
    d_z = weight * own[2] + more_z;
    motor_x = motor_in_x + d_x;
    motor_y = motor_in_y + d_y;
    motor_z = motor_in_z + d_z;
}

FUNCTION(feedback) {
    fb_x = drive_x - d_x;
    fb_y = drive_y - d_y;
    fb_z = drive_z - d_z;
}
