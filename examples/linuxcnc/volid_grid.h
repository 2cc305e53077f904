/* SPDX-License-Identifier: GPL-2.0-or-later
 *
 * A grid of corrections over X, Y, Z: read from a file that volid writes (`volid export --cnc linuxcnc-hal`), and
 * interpolated linearly in each direction (trilinear); beyond the first and last node the value there is held.
 *
 * The file is a sequence of words, separated by blanks or line ends; "#" begins a comment that ends with its line:
 *
 *     volid-hal-grid 1                  format and version
 *     type L-VOL                        what it corrects, for people
 *     tool 0 0 -150                     tool vector that it holds for
 *     unit mm                           of everything: mm or inch, that of the machine
 *     sign compensation                 values are added to the commands
 *     nodes X 3  0 500 1000             number of nodes and their positions, rising; a single node: no dependence
 *     nodes Y 2  0 600
 *     nodes Z 2  -500 0
 *     values 12                         number of nodes in all, then for each node dX dY dZ;
 *     0.0 0.0 0.0 ...                   X changes slowest, Z fastest (C order)
 *     end
 *
 * Nothing here knows of HAL, so that it can be tested without it.
 */
#ifndef VOLID_GRID_H
#define VOLID_GRID_H

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define VOLID_MOST_NODES 2000000L /* of a grid; 24 bytes each */
#define VOLID_LARGEST 1e6          /* of positions and corrections */
#define VOLID_WORD 64

typedef struct {
    long count[3];    /* nodes in X, Y, Z */
    double *nodes[3]; /* their positions */
    double *values;   /* count[0] * count[1] * count[2] * 3 */
    long cell[3];     /* where the last position lay, from which the next one is looked for */
} volid_grid;

typedef struct {
    FILE *file;
    int line;
    char word[VOLID_WORD];
    char *problem; /* what is wrong, at least 200 characters */
} volid_reader;

/* The next word; 0 at the end of the file, where it is empty, or if it is too long. */
static int volid_next(volid_reader *r) {
    int c = fgetc(r->file), n = 0;
    while (c != EOF && (isspace(c) || c == '#')) {
        if (c == '#')
            while (c != EOF && c != '\n') c = fgetc(r->file);
        if (c == '\n') r->line++;
        if (c != EOF) c = fgetc(r->file);
    }
    for (; c != EOF && !isspace(c) && c != '#' && n < VOLID_WORD - 1; c = fgetc(r->file)) r->word[n++] = (char)(c ? c : '?');
    r->word[n] = '\0';
    if (c != EOF) ungetc(c, r->file);
    return n > 0 && (c == EOF || isspace(c) || c == '#');
}

static int volid_wrong(volid_reader *r, const char *expected) {
    snprintf(r->problem, 200, "line %d: found %s%.40s%s, expected %.100s", r->line, r->word[0] ? "'" : "the end of the file",
             r->word, r->word[0] ? "'" : "", expected);
    return 0;
}

static int volid_expect(volid_reader *r, const char *word) {
    return (volid_next(r) && strcmp(r->word, word) == 0) || volid_wrong(r, word);
}

static int volid_number(volid_reader *r, double *value) {
    char *end;
    if (!volid_next(r)) return volid_wrong(r, "a number");
    *value = strtod(r->word, &end);
    if (r->word[strspn(r->word, "+-.0123456789eE")] != '\0') return volid_wrong(r, "a number"); /* no nan, no hexadecimal */
    return (*end == '\0' && fabs(*value) <= VOLID_LARGEST) || volid_wrong(r, "a number of at most 1e6");
}

static int volid_count(volid_reader *r, long *value) {
    char *end;
    if (!volid_next(r)) return volid_wrong(r, "a number of nodes");
    *value = strtol(r->word, &end, 10);
    return (*end == '\0' && *value >= 1 && *value <= VOLID_MOST_NODES) || volid_wrong(r, "a number of nodes, 1 to 2000000");
}

/* The next word, one of several in `allowed`, "one of: " and each with a blank before and after it. */
static int volid_one_of(volid_reader *r, const char *allowed) {
    char enclosed[VOLID_WORD + 2];
    volid_next(r);
    snprintf(enclosed, sizeof enclosed, " %s ", r->word);
    return (r->word[0] && strstr(strchr(allowed, ':'), enclosed)) || volid_wrong(r, allowed);
}

static int volid_header(volid_reader *r) {
    double tool;
    if (!volid_expect(r, "volid-hal-grid") || !volid_expect(r, "1") || !volid_expect(r, "type")) return 0;
    if (!volid_one_of(r, "one of: L-POS L-STR L-SQU L-ANG L-VOL L-SPEC ") || !volid_expect(r, "tool")) return 0;
    for (int k = 0; k < 3; k++)
        if (!volid_number(r, &tool)) return 0;
    return volid_expect(r, "unit") && volid_one_of(r, "one of: mm inch ") && volid_expect(r, "sign") &&
           volid_expect(r, "compensation");
}

static int volid_nodes(volid_reader *r, volid_grid *g, int k) {
    const char *letters[3] = {"X", "Y", "Z"};
    if (!volid_expect(r, "nodes") || !volid_expect(r, letters[k]) || !volid_count(r, &g->count[k])) return 0;
    g->nodes[k] = malloc((size_t)g->count[k] * sizeof(double));
    if (!g->nodes[k]) return volid_wrong(r, "fewer nodes: no memory left");
    for (long i = 0; i < g->count[k]; i++) {
        if (!volid_number(r, &g->nodes[k][i])) return 0;
        if (i > 0 && g->nodes[k][i] <= g->nodes[k][i - 1]) return volid_wrong(r, "rising positions of nodes");
    }
    return 1;
}

static int volid_values(volid_reader *r, volid_grid *g) {
    long stated, all = 1;
    for (int k = 0; k < 3; k++) {
        if (all > VOLID_MOST_NODES / g->count[k]) return volid_wrong(r, "at most 2000000 nodes in all");
        all *= g->count[k];
    }
    if (!volid_expect(r, "values") || !volid_count(r, &stated)) return 0;
    if (stated != all) return volid_wrong(r, "the product of the numbers of nodes");
    g->values = malloc((size_t)all * 3 * sizeof(double));
    if (!g->values) return volid_wrong(r, "fewer nodes: no memory left");
    for (long i = 0; i < 3 * all; i++)
        if (!volid_number(r, &g->values[i])) return 0;
    if (!volid_expect(r, "end")) return 0;
    return (!volid_next(r) && !r->word[0]) || volid_wrong(r, "nothing after 'end'");
}

static void volid_free(volid_grid *g) {
    for (int k = 0; k < 3; k++) free(g->nodes[k]);
    free(g->values);
    memset(g, 0, sizeof *g);
}

/* Reads a file; 0 if it cannot, with the reason in `problem` (200 characters). */
static int volid_read(const char *name, volid_grid *g, char *problem) {
    volid_reader r = {fopen(name, "r"), 1, "", problem};
    char mark[3];
    int good;
    problem[0] = '\0';
    memset(g, 0, sizeof *g);
    if (!r.file) {
        snprintf(problem, 200, "the file cannot be opened");
        return 0;
    }
    if (fread(mark, 1, 3, r.file) != 3 || memcmp(mark, "\xef\xbb\xbf", 3) != 0) rewind(r.file); /* of some editors */
    good = volid_header(&r) && volid_nodes(&r, g, 0) && volid_nodes(&r, g, 1) && volid_nodes(&r, g, 2) && volid_values(&r, g);
    fclose(r.file);
    if (!good) volid_free(g);
    return good;
}

/* The cell of one axis and the share of its upper node; true if the position lies beyond the nodes. */
static int volid_share(volid_grid *g, int k, double x, double *share) {
    const double *nodes = g->nodes[k];
    long last = g->count[k] - 1, i = g->cell[k];
    *share = 0.0;
    if (last == 0) return 0;
    if (!(x > nodes[0])) { /* a position that is no number counts as the first one */
        g->cell[k] = 0;
        return x < nodes[0];
    }
    if (x >= nodes[last]) {
        g->cell[k] = last - 1;
        *share = 1.0;
        return x > nodes[last];
    }
    while (x < nodes[i]) i--; /* from one period to the next the cell seldom changes */
    while (x >= nodes[i + 1]) i++;
    g->cell[k] = i;
    *share = (x - nodes[i]) / (nodes[i + 1] - nodes[i]);
    return 0;
}

/* Corrections of X, Y, Z at a position; returns whether it lies beyond the nodes. */
static int volid_correction(volid_grid *g, const double position[3], double correction[3]) {
    double share[3];
    int beyond = 0;
    for (int k = 0; k < 3; k++) beyond |= volid_share(g, k, position[k], &share[k]);
    correction[0] = correction[1] = correction[2] = 0.0;
    for (int corner = 0; corner < 8; corner++) {
        double weight = 1.0;
        long at = 0;
        for (int k = 0; k < 3; k++) {
            int up = corner >> k & 1;
            weight *= up ? share[k] : 1.0 - share[k];
            at = at * g->count[k] + g->cell[k] + up;
        }
        if (weight == 0.0) continue; /* also where there is no upper node */
        for (int k = 0; k < 3; k++) correction[k] += weight * g->values[3 * at + k];
    }
    return beyond;
}

#endif
