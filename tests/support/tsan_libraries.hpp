// What ThreadSanitizer finds in other people's libraries; everything else stays reported. Include
// it in every file of a program that has to do with one of them.
//  - OpenCV's imgcodecs sets up GDAL at its first use, and GDAL takes two of its own locks in
//    either order on one thread.
//  - OpenNI 2 unlocks mutexes of its own that it has not locked, races on its own state and leaves
//    a driver's thread behind. It never calls us back: a stack with it in it is its own.
#pragma once

#if defined(__SANITIZE_THREAD__)
extern "C" const char* __tsan_default_suppressions();
extern "C" [[gnu::used]] inline const char* __tsan_default_suppressions() {
  return "deadlock:libgdal\nmutex:libOpenNI2\nrace:libOpenNI2\nthread:OpenNI2/Drivers/\n";
}
#endif
