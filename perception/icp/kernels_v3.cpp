#include <immintrin.h>

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "perception/icp/kernels.hpp"

#pragma GCC target("arch=x86-64-v3")

namespace perception::icp {
namespace {
#include "perception/icp/kernels.inl"
}  // namespace

const Kernels kV3Kernels{
    "v3", accumulate_row, accumulate_row_cross, bilateral_row, normal_row, to_metres_row, half_row};

}  // namespace perception::icp
