# One folder, one library: the rules every target of the project is built by.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
set(CMAKE_LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/lib)

set(ALHAZEN_SANITIZER "" CACHE STRING "empty, address (with undefined) or thread")
option(ALHAZEN_FUZZ "build the libFuzzer targets" OFF)

# Release keeps our own checks: ALHAZEN_CHECK does not depend on NDEBUG.
set(CMAKE_CXX_FLAGS_RELEASE "-O3 -DNDEBUG")
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O1 -g1")

find_program(ALHAZEN_CCACHE ccache)
if(ALHAZEN_CCACHE)
  # No hash of the build folder: clones of one tree share what was compiled.
  # The sloppiness is what ccache asks for before it takes precompiled headers.
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${PROJECT_SOURCE_DIR}
      CCACHE_NOHASHDIR=1 CCACHE_SLOPPINESS=pch_defines,time_macros ${ALHAZEN_CCACHE})
endif()

add_compile_options(-Wall -Wextra -Wpedantic -Wconversion -Wshadow -Wnon-virtual-dtor
  -Woverloaded-virtual -Werror)
# g++ 12 sees overlaps in "text" + std::string(…) that are not there (its bug 105651).
add_compile_options($<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>)
if(CMAKE_UNITY_BUILD)
  # The same with more of a folder in sight. And it takes an included .cc for a header, whose types
  # should not use the unnamed namespace.
  add_compile_options($<$<CXX_COMPILER_ID:GNU>:-Wno-array-bounds> $<$<CXX_COMPILER_ID:GNU>:-Wno-stringop-overflow>
    $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()
if(ALHAZEN_SANITIZER STREQUAL "address")
  add_compile_options(-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
  add_link_options(-fsanitize=address,undefined)
elseif(ALHAZEN_SANITIZER STREQUAL "thread")
  add_compile_options(-fsanitize=thread)
  add_link_options(-fsanitize=thread)
endif()
if(ALHAZEN_FUZZ)
  add_compile_options(-fsanitize=fuzzer-no-link)
endif()

find_package(Threads REQUIRED)
find_package(PkgConfig REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(TBB REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(embree 3 REQUIRED)
find_package(spdlog REQUIRED)
find_package(OpenCV 4 REQUIRED COMPONENTS core imgproc imgcodecs calib3d)
find_package(OpenEXR REQUIRED)
find_package(GTest REQUIRED)
find_package(benchmark REQUIRED)
pkg_check_modules(HWY REQUIRED IMPORTED_TARGET libhwy)
pkg_check_modules(TOMLPP REQUIRED IMPORTED_TARGET tomlplusplus)
pkg_check_modules(ZMQ REQUIRED IMPORTED_TARGET libzmq)
pkg_check_modules(SQLITE REQUIRED IMPORTED_TARGET sqlite3)
pkg_check_modules(SYSTEMD REQUIRED IMPORTED_TARGET libsystemd)
pkg_check_modules(XXHASH REQUIRED IMPORTED_TARGET libxxhash)
find_package(CLI11 REQUIRED)

# The presets release, asan, tsan and fuzz compile files of a folder together and read the headers of
# others that many files need once. The other presets take every file alone: there one that forgets
# an include fails, and tests/CMakeLists.txt has clang-tidy look so at what changed.
set(ALHAZEN_PRECOMPILED <algorithm> <array> <chrono> <cmath> <filesystem> <fstream> <functional> <map>
    <memory> <mutex> <optional> <random> <set> <span> <stop_token> <string> <string_view> <thread>
    <utility> <variant> <vector> <Eigen/Core> <Eigen/Geometry> <Eigen/LU> <nlohmann/json.hpp>)
if(CMAKE_UNITY_BUILD)
  function(alhazen_precompiled target)
    target_link_libraries(${target} PRIVATE Eigen3::Eigen nlohmann_json::nlohmann_json)
    target_precompile_headers(${target} PRIVATE ${ALHAZEN_PRECOMPILED} ${ARGN})
    if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
      # With a time in it no two builds would share the file.
      target_compile_options(${target} PRIVATE "SHELL:-Xclang -fno-pch-timestamp")
    endif()
  endfunction()
  # A library's code and a program's differ in their flags: each kind has its own.
  file(GENERATE OUTPUT ${CMAKE_BINARY_DIR}/precompiled.cc CONTENT "int main() {}\n")
  add_library(alhazen_precompiled_library OBJECT ${CMAKE_BINARY_DIR}/precompiled.cc)
  alhazen_precompiled(alhazen_precompiled_library)
  add_executable(alhazen_precompiled_test ${CMAKE_BINARY_DIR}/precompiled.cc)
  target_link_libraries(alhazen_precompiled_test PRIVATE GTest::gmock)
  target_compile_options(alhazen_precompiled_test PRIVATE $<$<CONFIG:Release>:-O1>)
  alhazen_precompiled(alhazen_precompiled_test <gmock/gmock.h> <gtest/gtest.h>)
endif()

# alhazen_precompile(TARGET library|test): TARGET's files begin with what was precompiled.
function(alhazen_precompile target kind)
  if(CMAKE_UNITY_BUILD)
    target_precompile_headers(${target} REUSE_FROM alhazen_precompiled_${kind})
    if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
      target_compile_options(${target} PRIVATE "SHELL:-Xclang -fno-pch-timestamp")
    endif()
  endif()
endfunction()

# alhazen_library(NAME [PUBLIC targets…] [PRIVATE targets…])
# The sources are all .cc files of the current folder's sub-folder with the last part of NAME's path.
# Include paths start at the project's root: "reconstruct/vote/octree.h".
function(alhazen_library folder)
  cmake_parse_arguments(ARG "" "" "PUBLIC;PRIVATE" ${ARGN})
  cmake_path(GET folder FILENAME name)
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${folder}/*.cc)
  if(sources)
    add_library(alhazen_${name} STATIC ${sources})
    target_include_directories(alhazen_${name} PUBLIC ${PROJECT_SOURCE_DIR})
    target_link_libraries(alhazen_${name} PUBLIC alhazen::api ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
    alhazen_precompile(alhazen_${name} library)
  else()
    add_library(alhazen_${name} INTERFACE)
    target_include_directories(alhazen_${name} INTERFACE ${PROJECT_SOURCE_DIR})
    target_link_libraries(alhazen_${name} INTERFACE alhazen::api ${ARG_PUBLIC})
  endif()
  add_library(alhazen::${name} ALIAS alhazen_${name})
endfunction()

# alhazen_driver(NAME SOURCES … LIBRARIES …): lib/alhazen-NAME.so, exporting its entry alone.
function(alhazen_driver name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LIBRARIES" ${ARGN})
  add_library(alhazen-${name} MODULE ${ARG_SOURCES})
  set_target_properties(alhazen-${name} PROPERTIES PREFIX "" CXX_VISIBILITY_PRESET hidden
    VISIBILITY_INLINES_HIDDEN ON)
  target_include_directories(alhazen-${name} PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(alhazen-${name} PRIVATE alhazen::api ${ARG_LIBRARIES})
  target_link_options(alhazen-${name} PRIVATE -Wl,--exclude-libs,ALL)
  # The clang sanitizer runtimes live in the executable, so there symbols stay open until then.
  if(NOT (ALHAZEN_SANITIZER AND CMAKE_CXX_COMPILER_ID STREQUAL "Clang"))
    target_link_options(alhazen-${name} PRIVATE -Wl,--no-undefined)
  endif()
  if(CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    target_compile_options(alhazen-${name} PRIVATE -Wglobal-constructors -Wexit-time-destructors)
  endif()
endfunction()

# alhazen_test(NAME LABEL label [FOLDER folder] [COST n] [LIBRARIES targets…]): all *_test.cc of the
# folder. COST: the longest under sanitizers begin first, so that two cores end together.
function(alhazen_test name)
  cmake_parse_arguments(ARG "" "LABEL;FOLDER;COST" "LIBRARIES" ${ARGN})
  if(NOT ARG_FOLDER)
    set(ARG_FOLDER ${name})
  endif()
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${ARG_FOLDER}/*_test.cc)
  if(NOT sources)
    return()
  endif()
  set(target ${ARG_LABEL}_${name})
  add_executable(${target} ${sources})
  if(ALHAZEN_SANITIZER STREQUAL "thread")
    target_sources(${target} PRIVATE ${PROJECT_SOURCE_DIR}/tests/support/one_tbb_thread.cc)
    target_link_libraries(${target} PRIVATE TBB::tbb)
  endif()
  target_include_directories(${target} PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(${target} PRIVATE alhazen::api ${ARG_LIBRARIES} GTest::gmock GTest::gtest_main)
  target_compile_definitions(${target} PRIVATE ALHAZEN_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
    ALHAZEN_BINARY_DIR="${CMAKE_BINARY_DIR}")
  # What is tested is optimised; what tests is not worth the time.
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  alhazen_precompile(${target} test)
  add_test(NAME ${ARG_LABEL}.${name} COMMAND ${target})
  if(ARG_COST)
    set_tests_properties(${ARG_LABEL}.${name} PROPERTIES COST ${ARG_COST})
  endif()
  set_tests_properties(${ARG_LABEL}.${name} PROPERTIES LABELS ${ARG_LABEL} TIMEOUT 900
    ENVIRONMENT "TSAN_OPTIONS=suppressions=${PROJECT_SOURCE_DIR}/tests/tsan.supp:halt_on_error=1;LSAN_OPTIONS=suppressions=${PROJECT_SOURCE_DIR}/tests/lsan.supp;ALHAZEN_DATA=$ENV{ALHAZEN_DATA}")
endfunction()
