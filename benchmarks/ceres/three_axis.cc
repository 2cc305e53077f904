// The three-axis distance cases for Ceres Solver, with derivatives by hand: the peer that a C++ programmer would write.
//
// Usage: three_axis PROBLEM.bin SOLVER THREADS, SOLVER one of dense, sparse, qr. Reads commands from standard input:
//   solve            from the start in the file; answers "seconds cost iterations" and the unknowns in SOLUTION lines
//   loop N           N fits of newly drawn readings, each begun at the last solution; answers "seconds"
// The file (little endian doubles): m, stations, then per curve (18): axis, width w, P (14 x w) row by row; q_ref (3); theta (sum w),
// squareness (3), stations (4 each: x, y, z, dead path); per row: first coefficient (3), weights (12), q (3), tool (3), station,
// reading, 1/u. Curves stand axis by axis Y', X', Z, each EX, EY, EZ, EA, EB, EC.
#include <ceres/ceres.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>
#include <random>
#include <string>
#include <vector>

namespace {

struct Curve {
  int axis, width;
  std::vector<double> p;  // 14 x width
};

struct Row {
  int first[3];
  double weight[3][4], q[3], tool[3];
  int station;
  double reading, inverse_u;
};

struct V {
  double x, y, z;
};
V operator+(V a, V b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
V operator-(V a, V b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
V operator*(double s, V a) { return {s * a.x, s * a.y, s * a.z}; }
V cross(V a, V b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
V turn(V w, V x) {  // to second order, as volid's chain
  V first = cross(w, x);
  return x + first + 0.5 * cross(w, first);
}

std::vector<Curve> curves;
double reference[3];

// One distance: 18 curve blocks, squareness, station.
class Distance : public ceres::CostFunction {
 public:
  explicit Distance(const Row* row) : row_(row) {
    set_num_residuals(1);
    for (const Curve& c : curves) mutable_parameter_block_sizes()->push_back(c.width);
    mutable_parameter_block_sizes()->push_back(3);
    mutable_parameter_block_sizes()->push_back(4);
  }

  bool Evaluate(double const* const* x, double* residual, double** jacobian) const override {
    double e[3][6], slope[18][14];
    for (int k = 0; k < 18; ++k) {
      const Curve& c = curves[k];
      const double* weight = row_->weight[c.axis];
      const double* p = &c.p[row_->first[c.axis] * c.width];
      double value = 0.0;
      for (int j = 0; j < c.width; ++j) {
        slope[k][j] = weight[0] * p[j] + weight[1] * p[c.width + j] + weight[2] * p[2 * c.width + j] +
                      weight[3] * p[3 * c.width + j];
        value += slope[k][j] * x[k][j];
      }
      e[c.axis][k % 6] = value;
    }
    const double* s = x[18];  // EC0Y, EA0Z, EB0Z
    const double y = row_->q[0] - reference[0], z = row_->q[2] - reference[2];
    e[0][0] -= s[0] * y;
    e[2][1] -= s[1] * z;
    e[2][0] += s[2] * z;
    const V w[3] = {{e[0][3], e[0][4], e[0][5]}, {e[1][3], e[1][4], e[1][5]}, {e[2][3], e[2][4], e[2][5]}};
    const V t[3] = {{e[0][0], e[0][1], e[0][2]}, {e[1][0], e[1][1], e[1][2]}, {e[2][0], e[2][1], e[2][2]}};
    // Z on the tool side: N D; X' and Y' carry the workpiece: D N.
    const V in_z = {row_->tool[0], row_->tool[1], row_->tool[2]};
    const V in_x = turn(w[2], in_z) + t[2] + V{row_->q[1], 0.0, row_->q[2]};
    const V in_y = turn(w[1], in_x) + t[1] + V{0.0, row_->q[0], 0.0};
    const V point = turn(w[0], in_y) + t[0];
    const V arm = point - V{x[19][0], x[19][1], x[19][2]};
    const double d = std::sqrt(arm.x * arm.x + arm.y * arm.y + arm.z * arm.z);
    residual[0] = (d + x[19][3] - row_->reading) * row_->inverse_u;
    if (jacobian == nullptr) return true;

    V n = (row_->inverse_u / d) * arm;
    const V station = n, input[3] = {in_y, in_x, in_z};
    double g[3][6];
    for (int a = 0; a < 3; ++a) {
      const V x0 = input[a];
      const V rotation = cross(x0, n) + 0.5 * (cross(cross(w[a], x0), n) + cross(x0, cross(n, w[a])));
      g[a][0] = n.x, g[a][1] = n.y, g[a][2] = n.z;
      g[a][3] = rotation.x, g[a][4] = rotation.y, g[a][5] = rotation.z;
      const V back = cross(w[a], n);
      n = n - back + 0.5 * cross(w[a], back);
    }
    for (int k = 0; k < 18; ++k) {
      if (jacobian[k] == nullptr) continue;
      const Curve& c = curves[k];
      for (int j = 0; j < c.width; ++j) jacobian[k][j] = g[c.axis][k % 6] * slope[k][j];
    }
    if (jacobian[18] != nullptr) {
      jacobian[18][0] = -g[0][0] * y;
      jacobian[18][1] = -g[2][1] * z;
      jacobian[18][2] = g[2][0] * z;
    }
    if (jacobian[19] != nullptr) {
      jacobian[19][0] = -station.x, jacobian[19][1] = -station.y, jacobian[19][2] = -station.z;
      jacobian[19][3] = row_->inverse_u;
    }
    return true;
  }

 private:
  const Row* row_;
};

double number(FILE* file) {
  double value;
  if (std::fread(&value, sizeof value, 1, file) != 1) std::exit(3);
  return value;
}

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  FILE* file = argc == 4 ? std::fopen(argv[1], "rb") : nullptr;
  if (file == nullptr) return 2;
  const int m = static_cast<int>(number(file)), stations = static_cast<int>(number(file));
  for (int k = 0; k < 18; ++k) {
    Curve c;
    c.axis = static_cast<int>(number(file));
    c.width = static_cast<int>(number(file));
    for (int i = 0; i < 14 * c.width; ++i) c.p.push_back(number(file));
    curves.push_back(c);
  }
  for (double& r : reference) r = number(file);
  std::vector<int> place;
  int size = 0;
  for (const Curve& c : curves) place.push_back(size), size += c.width;
  std::vector<double> start;
  for (int i = 0; i < size + 3 + 4 * stations; ++i) start.push_back(number(file));
  std::vector<Row> rows(m);
  for (Row& r : rows) {
    for (int& f : r.first) f = static_cast<int>(number(file));
    for (auto& w : r.weight)
      for (double& v : w) v = number(file);
    for (double& v : r.q) v = number(file);
    for (double& v : r.tool) v = number(file);
    r.station = static_cast<int>(number(file));
    r.reading = number(file);
    r.inverse_u = number(file);
  }
  std::vector<double> x = start;
  ceres::Problem problem;
  for (const Row& r : rows) {
    std::vector<double*> blocks;
    for (int p : place) blocks.push_back(&x[p]);
    blocks.push_back(&x[size]);
    blocks.push_back(&x[size + 3 + 4 * r.station]);
    problem.AddResidualBlock(new Distance(&r), nullptr, blocks);
  }
  ceres::Solver::Options options;
  const std::string solver = argv[2];
  options.linear_solver_type = solver == "dense"    ? ceres::DENSE_NORMAL_CHOLESKY
                               : solver == "sparse" ? ceres::SPARSE_NORMAL_CHOLESKY
                                                    : ceres::DENSE_QR;
  options.num_threads = std::atoi(argv[3]);
  options.initial_trust_region_radius = 1e16;  // Gauss-Newton unless it fails
  options.function_tolerance = 1e-12;
  options.gradient_tolerance = 1e-12;
  options.parameter_tolerance = 1e-10;
  options.logging_type = ceres::SILENT;

  std::string command;
  while (std::cin >> command) {
    ceres::Solver::Summary summary;
    if (command == "solve") {
      x = start;
      const double began = now();
      ceres::Solve(options, &problem, &summary);
      std::printf("%.9f %.12e %d", now() - began, summary.final_cost, static_cast<int>(summary.iterations.size()));
      for (double v : x) std::printf(" %.17g", v);
    } else if (command == "loop") {
      int count;
      std::cin >> count;
      const std::vector<double> solution = x;
      std::vector<double> exact(m);
      std::mt19937_64 generator(0);
      std::normal_distribution<double> normal;
      double total = 0.0;
      for (int i = 0; i < m; ++i) exact[i] = rows[i].reading;
      for (int trial = 0; trial < count; ++trial) {
        const double began = now();
        for (int i = 0; i < m; ++i) rows[i].reading = exact[i] + normal(generator) / rows[i].inverse_u;
        x = solution;
        ceres::Solve(options, &problem, &summary);
        total += now() - began;
      }
      for (int i = 0; i < m; ++i) rows[i].reading = exact[i];
      x = solution;
      std::printf("%.9f", total);
    }
    std::printf("\n");
    std::fflush(stdout);
  }
  return 0;
}
