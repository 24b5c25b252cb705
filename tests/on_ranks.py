"""What `make test` runs on two and three ranks; `pytest --long` runs all of it on any number."""

#: Tests of what ranks do to each other, on two of them in all cases.
EVERY_CASE = (
    "test_bad_input",
    "test_hostile",
    "test_messages",
    "test_results",
)
#: Tests of which every case runs on one rank, every second on two, and every third on three.
ON_ANY = ("test_golden",)
#: Of the record what takes several times as long on ranks, for hundreds of small linear systems;
#: paths by arc length, their records, histories of bonds and Uzawa are in other tests there too.
LONG_ON_RANKS = ("path with a record", "path that snaps back", "Uzawa", "history of a crack")
#: Tests on two ranks beside those of `ON_THREE`: for every mechanism of a file one that ranks share
#: in, short where there is a choice. Algebra, laws and pictures of one rank are seen serially.
ON_TWO = {
    "test_adhesion": (
        *("viscosity", "shear_under_pressure", "jacobian_by_taylor", "a_field_of_bonds"),
        *("bad_input",),
    ),
    "test_adhesion_recovers": ("jacobian_by_taylor", "bad_input"),
    "test_affine": ("a_density_that_moves",),
    "test_algorithms": ("energies_fall", "data_that_are_refused"),
    "test_all_solutions_3d": (
        *("words_that_do_not_fit", "what_is_refused_by_name", "a_step_of_a_history"),
    ),
    "test_anisotropic": ("mirrored_fibres_hold_slip_to_the_left",),
    "test_arc_length": ("bad_input", "of_two_that_are_alike"),
    "test_at_rest": ("without_a_load", "on_the_points"),
    "test_axisymmetric": (
        *("uniform_pressure_on_a_disc", "lame", "multigrid", "uniform_strain", "units"),
        *("surfaces_that_disagree", "the_axis_is_held", "large_sliding", "a_branch"),
    ),
    "test_benchmarks": (
        *("settings_by_name", "elastic_solution_is_in_equilibrium", "seconds_of_the_surface"),
    ),
    "test_between_runs": (
        *("another_evolution_of_a_problem_needs_a_start", "steps_have_their_states"),
        *("an_unloaded_start_is_a_solution", "data_that_are_changed_between_two_runs_of_a_record"),
    ),
    "test_blocks": (
        *("friction_as_number_constant_and_field", "level_set_is_the_sphere"),
        *("two_surfaces_with_their_own_laws", "no_contact_at_all"),
        *("mixed_contact_on_facets_that_are_no_parallelograms",),
    ),
    "test_branch_counts": ("the_page", "where_branches_meet", "middles_and_bad_input"),
    "test_certificates": ("certificates_are_stored", "the_progress_of_a_proof", "bad_input"),
    "test_checks": (
        *("misfit_of_other_obstacles", "smallest_jacobian", "an_empty_cell_is_named"),
        *("obstacle_on_the_wrong_side",),
    ),
    "test_classical": (
        *("in_the_plane", "uzawa_without_augmentation", "penalty", "a_symmetry_plane"),
        *("a_body_that_slides_away", "what_fails_is_told_and_leaves_the_functions"),
        *("monitor_and_history", "what_is_refused"),
    ),
    "test_codes": ("an_answer_passes", "what_is_no_answer_is_refused"),
    "test_common_points": ("on_any_number_of_ranks", "fields_of_the_law", "bad_input"),
    "test_compliant": (
        *(
            "uniform_compression",
            "between_bodies",
        ),
        *("warning_and_bad_laws",),
    ),
    "test_continuation": (
        *("slip_that_goes_on", "correctors_agree", "an_exhausted_budget_keeps_what_was_found"),
        *("a_branch_that_ends", "a_start_at_an_end_of_the_range"),
    ),
    "test_core_in_small": (
        *("lengths_of_states_in_closed_form",),
        *("the_block_of_a_surface_is_inverted", "the_stiffness_of_points_of_two_surfaces"),
        "dofs_of_what_is_in_contact",
    ),
    "test_creep": ("creep", "what_is_lacking_is_said"),
    "test_critical_friction": (
        *("by_multigrid", "slips_of_one_sign_among_equal_coefficients"),
        *("hild_triangle", "slice_in_3d", "bad_input", "between_bodies", "double_coefficients"),
        *("slips_of_a_stiff_body_beside_a_soft_one", "how_far_multigrid_knows_them"),
        *("what_does_not_rub", "nodes_that_two_surfaces_hold"),
    ),
    "test_crossing_cracks": ("pairs_without_a_loop_keep_their_multipliers", "what_nobody_can_take"),
    "test_curved_friction": (
        *("space", "half_a_turn_in_a_step_is_refused", "refused", "held_in_part"),
    ),
    "test_demo_dragged_body": ("mesh_without_the_top", "unwritable_output", "bad_option"),
    "test_demo_hertz": ("line_contact_numbers", "numbers_do_not_depend_on_ranks", "bad_arguments"),
    "test_demos": ("hild_triangle_instance",),
    "test_diagram": (
        *("observers_see_the_branches_of_the_diagram", "three_pieces_that_meet_are_a_node"),
        *("budgets_and_bad_input",),
    ),
    "test_directions_of_slip": (
        *("few_eigenvalues", "one_body_serves_all_directions", "bad_input"),
    ),
    "test_disk": (
        "fields_on_a_full_disk",
        "something_is_in_the_way_of_fields",
        "what_a_killed_run_left_is_removed",
        "a_script_of_the_users_own_stays",
        "table_and_summary",
        "pictures",
        "a_record_on_a_full_disk_is_resumed",
        "a_record_that_cannot_begin",
        "a_record_that_nothing_is_in",
        "a_series_on_a_full_disk",
        "the_lock_says_who_holds_it",
        "a_process_that_has_the_journal_open_does_not_hold_it",
        "a_file_system_without_flock",
    ),
    "test_docs": ("theory",),
    "test_doubled_nodes": ("two_points_at_one_place_differ", "resumed_on_other_ranks"),
    "test_dropped": ("garbage_that_is_collected_while_meshes_are_freed",),
    "test_evolution": (
        *("what_has_slid_as_a_whole", "a_start_that_is_no_solution"),
        *("a_proof_is_of_the_step_that_was_taken", "where_nothing_continues"),
        *("bad_input",),
    ),
    "test_evolution_output": (
        *("a_series_step_by_step", "numbers_in_a_record"),
        *("tables_of_any_step",),
    ),
    "test_evolution_record": (
        "an_interrupted_run_resumes",
        *(
            "what_is_refused",
            "a_submesh_is_refused",
        ),
    ),
    "test_explorer": (
        "a_history",
        "records_that_are_damaged",
        "the_command",
    ),
    "test_factor": ("matrices_without_their_zeros",),
    "test_faces_in_small": ("places_that_other_ranks_know",),
    "test_following": ("a_block_by_following_the_load",),
    "test_found_again": ("each_form_is_that_of_dolfinx", "a_form_that_one_rank_alone_knows"),
    "test_friction_from_zero": ("from_zero_and_back",),
    "test_friction_limits": ("infinite_friction",),
    "test_given_normals": ("different_bulges", "bad_normals"),
    "test_guide": ("an_indenter", "a_motion"),
    "test_held_ends": ("patch_in_space", "one_pair_in_several_problems"),
    "test_hild_2005": ("critical_friction",),
    "test_increments": (
        *("increments_find_what_newton_finds", "the_load_is_what_it_was_after_a_failure"),
        *("budgets",),
    ),
    "test_interfaces": (
        *("adhesion_of_a_block", "interfaces_that_are_none"),
        *("law_that_is_not_finite",),
    ),
    "test_jumps": ("what_is_proved_of_a_coarse_step",),
    "test_manifest": (
        *("other_data_are_refused", "other_masses_are_refused"),
        *("a_branch_knows_its_functions",),
    ),
    "test_kinematics": (
        "derivatives_by_taylor",
        "forces_do_the_work_of_pressure_and_shear",
        "slips_since_the_last_step",
        "what_needs_a_constant_operator",
        "what_needs_the_nodes_opposite_to_stay",
    ),
    "test_kink_starts": (*("a_branch_from_a_state_without_load",),),
    "test_kinked_data": ("a_jump_in_a_part",),
    "test_kinks": ("a_batch_brackets_its_events", "bad_input"),
    "test_krylov": ("sign_of_the_determinant", "work_of_a_step"),
    "test_large_sliding": (
        *("around_a_cylinder", "refused", "a_gradient_that_vanishes"),
        *("a_rigid_body", "multigrid"),
    ),
    "test_law": ("nodal_rows_are_alart_curnier", "classification"),
    "test_lemke": ("data_that_it_does_not_take", "the_same_as_newton"),
    "test_linear_triangle": (
        "seed_example_at_its_start",
        "bad_input",
    ),
    "test_look": (
        *("a_floor_under_the_body", "a_plotter_can_be_changed", "continuous_fields_are_exact"),
        *("senses_of_slip_are_those_of_the_table", "looks_that_are_refused"),
    ),
    "test_mean_dilatation": ("stress_in_pictures",),
    "test_meshing": (
        *("read", "surface_by_name", "solve_with_names", "cells_by_name"),
        *("both_sides_of_a_crack_have_ds", "unknown_names", "names_that_differ"),
        *("files_read_differently", "a_drawing_that_ends_the_run", "missing_file"),
        *("not_a_gmsh_file", "model_that_does_not_fit"),
    ),
    "test_mortar": ("a_rounded_face", "bad_mortars", "a_warped_face_in_space"),
    "test_motion": (
        *("a_bar_step_by_step", "ranks_change_nothing", "bad_input"),
        *("what_the_velocity_level_refuses", "a_load_within_a_step"),
    ),
    "test_motion_data": (
        *("what_changes_in_mass_and_damping_is_refused", "a_start_off_what_is_prescribed"),
        *("a_density_that_is_negative_within_a_cell", "what_a_step_looks_at"),
        "a_later_run_begins_with_the_load_of_its_time",
    ),
    "test_motion_laws": (
        *("a_speed_is_needed", "what_differs_between_ranks", "a_body_of_revolution"),
        *("what_a_compliant_floor_holds", "a_floor_carries_what_it_touches"),
    ),
    "test_motion_solver": (
        *("residual_by_one_product", "static_problems_keep_their_hierarchy"),
        *("forcing_in_motion", "krylov_vectors_vanish_on_the_surface"),
    ),
    "test_motion_stability": ("what_does_not_jump",),
    "test_multigrid": (
        *("product_is_that_of_the_assembled_jacobian",),
        *("correction_solves_the_rows_of_the_surface",),
        *("preconditioner_for_other_systems", "options", "choice"),
        *("a_direct_solver_takes_over", "without_hypre", "hierarchy_is_kept"),
        *("an_aged_hierarchy_is_rebuilt",),
        *("smoothers_of_the_user", "nested_iteration", "nested_problems_must_agree", "forcing"),
        *("a_problem_is_freed_with_its_last_reference", "contact_rows_are_those_of_the_residual"),
    ),
    "test_nonlocal": (
        *("constant_pressure", "jacobian_by_taylor", "jacobian_between_bodies", "a_branch"),
        *("bad_laws_and_a_small_radius",),
    ),
    "test_observers": (
        "a_history_is_not_disturbed_by_who_writes_to_functions",
        *("a_record_comes_first", "an_observer_that_raises_on_one_rank_ends_a_history"),
    ),
    "test_open_tools": ("starts_below_a_rim",),
    "test_output": (
        *("von_mises_of_uniaxial_stress", "nodal_fields_are_the_table", "clamped_nodes"),
        *("integral_fields", "files_read_back", "two_surfaces", "unwritable_folder"),
        *("contact_table", "no_picture_in_a_missing_folder"),
    ),
    "test_own_law": (
        *("orthotropic_friction", "friction_never_pushes_along", "statuses_that_are_none"),
        *("fields_may_be_negative_where_the_law_allows_it",),
    ),
    "test_packaging": ("ranks_of_one_run_are_not_copies", "the_compiler_that_is_missing_is_named"),
    "test_overlap": (
        *("two_strips", "refused", "a_body_within_a_tool", "a_body_within_a_floor"),
        *("an_overlap_with_a_tool_is_removed", "beyond_the_middle_of_an_obstacle"),
    ),
    "test_pair": (
        *("a_gap_that_closes", "crack", "bad_pairs"),
        *("faces_of_different_meshes", "branches_on_a_held_body"),
    ),
    "test_pair_demos": ("a_crack_in_the_plane", "a_press_fit"),
    "test_parametric": (
        *(
            "friction_as_parameter",
            "gamma_must_be_a_scalar_constant",
        ),
        *("data_that_change_between_branches", "looking_for_solutions_leaves_no_trace"),
        *("evaluating_writes_no_function", "what_drives_changes_between_branches"),
        *("an_obstacle_that_is_moved_into_clamped_nodes",),
    ),
    "test_path_record": (*("the_journal_says_what_was_followed",),),
    "test_paths_in_small": (*("matrices_that_differ_in_rows_and_a_column",),),
    "test_planes_of_symmetry": (
        *("half_is_the_whole", "part_sees_what_the_whole_sees", "refused", "a_plane_that_moves"),
        *("a_plane_that_is_off_at_the_start",),
        *("what_crosses_a_plane_gives_a_warning", "walls_of_one_height"),
    ),
    "test_points_in_small": (*("the_size_of_facets_in_space",),),
    "test_point_problem": (
        *("round_trip", "the_file_of_fclib", "what_is_refused", "what_one_rank_gives"),
        *("files_beside_what_is_saved",),
    ),
    "test_progress": (
        *("progress_of_a_long_solve", "line_elsewhere", "progress_of_branches"),
        *("log_of_failures", "log_of_branches"),
    ),
    "test_proofs": ("several_surfaces", "a_proof_by_search", "data_that_have_changed"),
    "test_proved_rays": ("a_hyperelastic_block",),
    "test_rays": ("neighbours_are_brought_up_to_date",),
    "test_readme": ("readme_example", "landing_page_example_has_three_proved_solutions"),
    "test_record": (
        *("journal_says_what_was_followed", "fields_come_back_exactly"),
        *("a_torn_last_line_is_dropped", "the_journal_of_another_problem_is_refused"),
        "progress",
    ),
    "test_record_surfaces": (
        *("the_displacement_of_every_point", "on_another_number_of_ranks"),
        *("tables_of_contact_points",),
    ),
    "test_regions": ("figures_of_the_seed_example",),
    "test_renard": ("hild_triangle", "bad_input"),
    "test_reuse": (
        *("a_row_that_makes_it_singular", "work_of_a_nonlinear_body"),
        "the_mesh_is_not_hashed_at_every_residual",
        *("what_follows_from_a_state_is_made_of_one_evaluation", "a_product_is_not_made_twice"),
    ),
    "test_rigid_body": (
        *("a_punch_under_a_force", "tilting_in_three_dimensions", "two_surfaces_share_a_body"),
        *("bodies_that_nothing_holds", "all_solutions"),
        *("bad_input", "a_load_that_is_not_a_number", "loads_that_differ_between_ranks"),
        *("what_is_told",),
    ),
    "test_rigid_surface": (
        *("bad_use", "ranks_with_other_tools", "files"),
        "a_step_through_a_thin_tool_is_said",
    ),
    "test_architecture": ("layers",),
    "test_scales": ("material_that_changes",),
    "test_scripts": (
        *("bad_options", "journal_in_memory_is_that_of_a_record", "report_speaks_on_one_rank"),
        *("rows_as_csv",),
    ),
    "test_settling": ("rounds",),
    "test_shakedown": ("bad_input",),
    "test_shared_values": ("values_from_owners", "a_few_numbers_of_all_ranks"),
    "test_sides_in_small": (
        *("nodes_on_planes_of_symmetry", "values_at_places_of_any_rank", "parts_of_a_face"),
        *("who_takes_the_functions_of_vertices", "normals_of_a_face_at_its_nodes"),
        *("sections_of_bodies_of_revolution", "functions_that_have_one_value"),
    ),
    "test_sliding_in_small": (
        *("facets_that_may_be_opposite", "gauss_points_of_a_ring"),
        *("points_of_what_rings_have_in_common", "facets_that_slips_have_passed"),
        *("rates_of_friction_that_spreads", "entries_of_the_operator"),
    ),
    "test_sliding_pair": (
        *("patch_in_space", "branch", "a_record_of_another_sliding", "refused"),
        *(
            "overlap_is_refused",
            "self_contact",
            "self_contact_is_refused",
        ),
        "jacobian_of_bodies_that_spin",
    ),
    "test_sliding_steps": (
        "a_step_in_a_cycle_is_halved",
        "facets_that_a_step_passes",
    ),
    "test_slip_memory": ("a_static_start_has_slipped", "jacobian_by_taylor"),
    "test_small_sliding": (
        "far_and_turned",
        "uniqueness",
    ),
    "test_solutions": ("bad_input", "what_was_not_found_is_said"),
    "test_special_curves": ("what_is_refused",),
    "test_spins": ("on_any_number_of_ranks", "one_of_two_bodies_on_a_floor_spins"),
    "test_state": (
        *("restore_is_exact", "a_state_of_another_problem", "evaluators_at_a_state"),
        *("a_mesh_that_has_moved", "a_monitor_that_fails_on_one_rank", "files_of_a_state"),
    ),
    "test_stability": (
        *("stuck_neighbours", "few_eigenproblems", "3d", "bad_input"),
        *("damping_that_feeds_in_energy",),
    ),
    "test_start": (
        *("the_solver_keeps_no_factorisation",),
        *("a_problem_goes_on_after_its_objects_were_freed",),
        *("the_guess_finds_the_contact_in_fewer_steps",),
    ),
    "test_steady_sliding": (
        *("onset", "large_problems_by_slepc", "mode_shape", "bad_input", "animation"),
    ),
    "test_step_from": ("steps_one_by_one_are_a_history", "a_step_answers_what_a_problem_answers"),
    "test_stop": (
        *("a_run_that_is_stopped", "what_is_in_the_problem_when_it_is_asked"),
        *("what_cannot_stop", "one_rank_alone_stops", "a_record_of_a_run_that_is_stopped"),
    ),
    "test_stress_of_parts": ("of_each_tag",),
    "test_surface": (
        *("gap_and_normal_are_those_of_the_obstacle", "reaction_of_a_clamped_contact_node"),
        *("several_solves_in_one_process", "a_solve_can_be_repeated_and_started_warm"),
        *("monitor_sees_every_iterate",),
    ),
    "test_time_in_laws": ("in_a_history", "a_speed_alone"),
    "test_true_surface": ("a_press_fit", "bad_surfaces"),
    "test_two_faces": (
        *("forces_balance", "like_nodes_have_opposite_tractions", "files", "series"),
        *("names_that_make_the_same_file", "pressure_of_a_slave_that_is_partly_covered"),
    ),
    "test_two_parameters": ("one_element", "what_is_refused", "a_chart_in_a_file"),
    "test_uniqueness": (
        *("the_only_solution_in_space", "summary_with_and_without_a_verdict", "theory"),
        *("of_a_point_of_a_branch", "seconds_that_are_none"),
        "other_friction_under_open_points",
    ),
    "test_vtk": ("fields_as_vtk", "formats"),
    "test_wedging": ("time_that_is_over", "bad_input"),
    "test_weighted": ("in_space", "result_of_a_body"),
    "test_words": (
        *("tags_of_something_else", "points_with_nothing_opposite", "names_of_surfaces"),
        *("words_as_arguments",),
    ),
}
#: Tests on two and three ranks, of what depends on who owns what.
ON_THREE = {
    "test_adhesion": ("as_on_one_rank",),
    "test_affine": ("a_bulk_that_jumps_is_not_solved",),
    "test_all_solutions_3d": ("what_is_proved",),
    "test_bad_input": ("bad_numbers_on_one_rank_only", "a_rank_without_any_cell"),
    "test_blocks": ("oracle_forces", "ranks_and_ghost_modes", "patch"),
    "test_classical": ("in_space",),
    "test_common_points": ("patch", "patch_of_a_short_block"),
    "test_compliant": ("jacobian_by_taylor",),
    "test_continuation": ("path_with_two_nonsmooth_folds", "parity_is_that_of_mumps"),
    "test_core_in_small": (
        *("points_of_all_ranks_in_one_order", "places_of_columns_that_other_ranks_have"),
    ),
    "test_critical_friction": ("of_a_solution",),
    "test_crossing_cracks": ("blocks_under_unequal_pressures", "planes_that_cross"),
    "test_curved_friction": ("ranks", "jacobian"),
    "test_doubled_nodes": ("tables_do_not_depend_on_ranks",),
    "test_evolution": ("energy", "a_load_that_fails_on_one_rank"),
    "test_held_ends": ("patch",),
    "test_manifest": ("an_honest_resume_on_other_ranks",),
    "test_large_sliding": ("jacobian_by_taylor",),
    "test_law": ("jacobian_by_taylor",),
    "test_look": ("a_plotter_can_be_changed",),
    "test_mortar": ("patch", "patch_in_space", "a_slave_that_is_held"),
    "test_multigrid": ("same_as_direct", "filter_leaves_nothing_on_the_surface"),
    "test_nonlocal": ("ranks", "a_surface_on_one_rank_alone"),
    "test_output": ("pressure_as_a_function",),
    "test_pair": ("mirrored_bodies", "one_side_is_clamped"),
    "test_pair_multigrid": ("same_as_direct",),
    "test_parametric": ("derivative_by_gamma", "single_element"),
    "test_point_problem": ("what_is_saved_is_the_problem",),
    "test_properties": ("ranks",),
    "test_renard": ("of_a_solution",),
    "test_results": (
        "balance_of_all_forces",
        "support_as_a_field",
        "forces_of_nodes_between_vertices",
        "ghosts_follow_their_owners",
    ),
    "test_rigid_body": ("ranks", "the_jacobian"),
    "test_rigid_surface": ("jacobian", "flat_punch_and_ranks"),
    "test_scales": ("what_stays", "the_size_of_a_body_with_ranks_that_have_no_cell"),
    "test_self_contact_in_space": ("a_folded_plate", "jacobian"),
    "test_shared_values": ("sums_over_ranks", "a_few_numbers_of_all_ranks"),
    "test_sliding_pair": (
        *("jacobian", "patch", "wedge"),
        "a_motion_continues_from_its_record",
    ),
    "test_sliding_revolution": (
        "jacobian",
        "patch",
    ),
    "test_surface": ("points_lie_where_they_should", "facets_named_on_one_rank_only"),
    "test_uniqueness": ("the_only_solution",),
}
