# What `cmake --install` puts where, beside the libraries (teletact_install) and the program:
#   include/teletact/<module>/<folder>/   public headers; "rt/sched/admission.hpp" works as in the
#                                         tree
#   lib/cmake/teletact/                   find_package(teletact)
#   share/teletact/config/                scenes, fault plans, limits; found by the program from
#                                         bin/
#   share/teletact/console/               the operator's page (tools/console/page)
#   lib/systemd/system/                   units that run a box as a service
#   lib/sysusers.d/teletact.conf          their user
#   lib/modules-load.d/teletact.conf      the congestion control of their link
#   lib/tmpfiles.d/teletact.conf          the host's registry, root's from the start of the machine
include(CMakePackageConfigHelpers)
get_property(headers GLOBAL PROPERTY teletact_private_headers)
foreach(header ${headers})
  string(REPLACE "." "\\." header ${header})
  list(APPEND private REGEX "/${header}$" EXCLUDE)
endforeach()
foreach(part rt perception drivers tasks)
  install(EXPORT teletact_${part} NAMESPACE teletact:: FILE teletact_${part}.cmake
    DESTINATION ${TELETACT_INSTALL_CMAKE} COMPONENT ${part})
  install(DIRECTORY ${PROJECT_SOURCE_DIR}/${part} DESTINATION ${TELETACT_INSTALL_INCLUDE}
    COMPONENT ${part} FILES_MATCHING PATTERN "*.hpp" ${private})
endforeach()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/config DESTINATION ${TELETACT_INSTALL_INCLUDE}
  COMPONENT rt FILES_MATCHING PATTERN "*.hpp" ${private})
install(DIRECTORY ${PROJECT_SOURCE_DIR}/config DESTINATION ${CMAKE_INSTALL_DATADIR}/teletact
  COMPONENT program FILES_MATCHING PATTERN "*.toml" PATTERN "*.conf" PATTERN "*.rules"
  PATTERN "systemd" EXCLUDE)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/config/systemd/ DESTINATION lib/systemd/system
  COMPONENT program FILES_MATCHING PATTERN "*.service")
install(FILES ${PROJECT_SOURCE_DIR}/config/systemd/teletact.sysusers.conf DESTINATION lib/sysusers.d
  RENAME teletact.conf COMPONENT program)
install(FILES ${PROJECT_SOURCE_DIR}/config/systemd/teletact.modules.conf DESTINATION lib/modules-load.d
  RENAME teletact.conf COMPONENT program)
install(FILES ${PROJECT_SOURCE_DIR}/config/systemd/teletact.tmpfiles.conf DESTINATION lib/tmpfiles.d
  RENAME teletact.conf COMPONENT program)
configure_package_config_file(${PROJECT_SOURCE_DIR}/tools/cmake/teletactConfig.cmake.in
  ${PROJECT_BINARY_DIR}/teletactConfig.cmake INSTALL_DESTINATION ${TELETACT_INSTALL_CMAKE})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/teletactConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES
  ${PROJECT_BINARY_DIR}/teletactConfig.cmake ${PROJECT_BINARY_DIR}/teletactConfigVersion.cmake
  ${PROJECT_SOURCE_DIR}/tools/cmake/FindOpenCVModules.cmake
  ${PROJECT_SOURCE_DIR}/tools/cmake/FindOmplLibrary.cmake
  ${PROJECT_SOURCE_DIR}/tools/cmake/FindLibGpiod.cmake
  ${PROJECT_SOURCE_DIR}/tools/cmake/FindLibUsb.cmake
  ${PROJECT_SOURCE_DIR}/tools/cmake/FindTurboJpeg.cmake
  ${PROJECT_SOURCE_DIR}/tools/cmake/FindLibav.cmake
  DESTINATION ${TELETACT_INSTALL_CMAKE} COMPONENT rt)
