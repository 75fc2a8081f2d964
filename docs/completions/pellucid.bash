# SPDX-License-Identifier: MIT
# Made by docs/completions/make_completions.py from what the program says of itself.
_pellucid()
{
    local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}
    local command=${COMP_WORDS[1]} method=screen-space i
    COMPREPLY=()
    if [ "$current" = = ]; then current=; elif [ "$before" = = ]; then before=${COMP_WORDS[COMP_CWORD-2]}; fi

    if [ "$COMP_CWORD" = 1 ]; then
        COMPREPLY=($(compgen -W "render merge check bake-layers methods materials profile bench compare view info help --help --version" -- "$current"))
        return
    fi
    [ "$command" = help ] && { COMPREPLY=($(compgen -W "render merge check bake-layers methods materials profile bench compare view info lengths scenes knobs output layers noise exit-codes environment files topics" -- "$current")); return; }
    for ((i = 2; i < COMP_CWORD - 1; i++)); do
        case ${COMP_WORDS[i]} in -m | --method) method=${COMP_WORDS[i+1]} ;; esac
    done
    case $command:$before in
    *:--angles) COMPREPLY=($(compgen -W "on off" -- "$current")); return ;;
    *:--background) COMPREPLY=($(compgen -W "environment transparent white grey black" -- "$current")); return ;;
    *:--boundary) COMPREPLY=($(compgen -W "rough smooth" -- "$current")); return ;;
    *:--compare) COMPREPLY=($(compgen -W "dipole better-dipole normalized-diffusion photon-beam monte-carlo all" -- "$current")); return ;;
    *:--curvature) COMPREPLY=($(compgen -W "on off" -- "$current")); return ;;
    *:--denoise) COMPREPLY=($(compgen -W "on off" -- "$current")); return ;;
    *:--dof) COMPREPLY=($(compgen -W "on off" -- "$current")); return ;;
    *:--engine) COMPREPLY=($(compgen -W "auto cpu vulkan" -- "$current")); return ;;
    *:--exit) COMPREPLY=($(compgen -W "balanced published" -- "$current")); return ;;
    *:--export) COMPREPLY=($(compgen -W "c glsl hlsl json" -- "$current")); return ;;
    *:--format) COMPREPLY=($(compgen -W "png exr hdr pfm" -- "$current")); return ;;
    render:--from | compare:--from | view:--from) COMPREPLY=($(compgen -W "front right back left top 34" -- "$current")); return ;;
    *:--log-level) COMPREPLY=($(compgen -W "none error warning info debug" -- "$current")); return ;;
    *:--methods) COMPREPLY=($(compgen -W "none screen-space image-space texture-space convolution layered hierarchical dipole path-trace single-scatter all" -- "$current")); return ;;
    *:--model) COMPREPLY=($(compgen -W "dipole better-dipole normalized-diffusion photon-beam monte-carlo" -- "$current")); return ;;
    *:--normals) COMPREPLY=($(compgen -W "file smooth flat" -- "$current")); return ;;
    *:--opposed) COMPREPLY=($(compgen -W "on off" -- "$current")); return ;;
    *:--pixel-filter) COMPREPLY=($(compgen -W "gaussian box" -- "$current")); return ;;
    *:--profile) COMPREPLY=($(compgen -W "material dipole better-dipole normalized-diffusion photon-beam monte-carlo" -- "$current")); return ;;
    *:--progress) COMPREPLY=($(compgen -W "text json" -- "$current")); return ;;
    *:--reference) COMPREPLY=($(compgen -W "screen-space image-space texture-space convolution layered hierarchical dipole path-trace single-scatter" -- "$current")); return ;;
    *:--single-scattering) COMPREPLY=($(compgen -W "on off" -- "$current")); return ;;
    *:--solver) COMPREPLY=($(compgen -W "hankel gaussian analytic all" -- "$current")); return ;;
    *:--specular) COMPREPLY=($(compgen -W "material ggx kelemen phong blinn-phong" -- "$current")); return ;;
    *:--studio) COMPREPLY=($(compgen -W "soft rim back window" -- "$current")); return ;;
    render:--tonemap | bench:--tonemap | view:--tonemap) COMPREPLY=($(compgen -W "reinhard linear filmic" -- "$current")); return ;;
    compare:--tonemap) COMPREPLY=($(compgen -W "reinhard aces linear filmic" -- "$current")); return ;;
    *:--unscattered) COMPREPLY=($(compgen -W "on off" -- "$current")); return ;;
    *:--up) COMPREPLY=($(compgen -W "y z" -- "$current")); return ;;
    *:-m | *:--method) COMPREPLY=($(compgen -W "none screen-space image-space texture-space convolution layered hierarchical dipole path-trace single-scatter" -- "$current")); return ;;
    esac
    case $before in
    --material) mapfile -t COMPREPLY < <(compgen -W "apple apple-juice apple-skin budweiser-beer cappuccino-powder chardonnay chicken1 chicken2 clorox coke coors-light-beer cranberry-juice cream espresso fish gatorade grape-juice head-and-shoulders-shampoo jade ketchup leaf lemon-tea-powder lowfat-chocolate-milk lowfat-milk lowfat-soy-milk marble marble-4gaussian merlot mint-mocha-coffee orange-juice orange-powder pacific-ocean-surface-water paint-coat pepsi pink-lemonade-powder potato reduced-milk regular-chocolate-milk regular-milk regular-soy-milk ruby-grapefruit-juice salt-powder shampoo skimmilk skin skin-2layer skin-3layer skin-4gaussian skin-6gaussian skin1 skin2 soap spectralon sprite strawberry-shampoo sugar-powder suisse-mocha-powder wax white-grapefruit-juice white-zinfandel wholemilk" -- "$current"; compgen -f -- "$current"); return ;;
    --set)
        compopt -o nospace +o filenames 2>/dev/null
        case $method in
        screen-space) COMPREPLY=($(compgen -S = -W "as gaussians profile input first edges foreshortening ssslevel correction maxdd lod kernel rank taps rotate strength through" -- "$current")) ;;
        image-space) COMPREPLY=($(compgen -S = -W "as samples adaptive progressive sampling tile views view-size renormalise jacobian reconstruct strength spread profile through misprint" -- "$current")) ;;
        texture-space) COMPREPLY=($(compgen -S = -W "as size gaussians charts border kernel stretch first tsm tsm-size through thickness fade soften lights strength cull mix" -- "$current")) ;;
        convolution) COMPREPLY=($(compgen -S = -W "as planes placement split restore threshold threshold-by resolution pixels visible surfaces behind-step through apart edges borders strength" -- "$current")) ;;
        layered) COMPREPLY=($(compgen -S = -W "as samples steps tolerance march refraction light-path planes epsilon lamps below shadows multiple diffuse" -- "$current")) ;;
        hierarchical) COMPREPLY=($(compgen -S = -W "as error density points near gaussians strength" -- "$current")) ;;
        dipole) COMPREPLY=($(compgen -S = -W "as error most sampling strength half" -- "$current")) ;;
        path-trace) COMPREPLY=($(compgen -S = -W "as samples error time-limit surface normals boundary bounces reentry events roulette acceleration connections half" -- "$current")) ;;
        single-scatter) COMPREPLY=($(compgen -S = -W "as error most distance refraction normals half" -- "$current")) ;;
        esac
        return ;;
    --checkpoint | --cross-section | --dump | --environment | --half | --inner | --input | --layers | --mask | --output | --token-file | -o) mapfile -t COMPREPLY < <(compgen -f -- "$current"); return ;;
    --ambient-samples | --angles | --animation | --background | --bloom | --bloom-radius | --bounces | --boundary | --camera | --checkpoint-every | --compare | --curvature | --denoise | --device | --dof | --down-to | --end-after | --engine | --environment-lights | --environment-rotate | --environment-scale | --eta | --exit | --export | --exposure | --exposures | --floor | --format | --frame-range | --frames | --from | --gaussians | --height | --indirect-samples | --layer | --layers-of | --light-samples | --limit | --line | --listen | --log-level | --map-size | --max-error | --method | --methods | --model | --msaa | --normals | --opposed | --pixel-filter | --points | --port | --ppd | --profile | --progress | --rank | --reference | --repeats | --roughness | --sample-range | --samples | --scene-range | --seed | --single-scattering | --size | --skin | --solver | --specular | --stops | --studio | --taps | --target-error | --thicken | --threads | --tile-range | --time | --time-limit | --to | --tonemap | --turntable | --unit | --unscattered | --up | --wavelength | --white | --width | -m) return ;;
    esac
    case $current in
    -*)
        case $command in
        render) COMPREPLY=($(compgen -W "--material --size --unit --camera --time --animation --allow-outside --limit --method --max-error --set --samples --time-limit --target-error --up --normals --thicken --from --studio --environment --environment-rotate --environment-scale --background --ground --checkpoint --checkpoint-every --sample-range --tile-range --frame-range --output --format --turntable --frames --dump --stats --engine --device --threads --json --progress --quiet --log-level --help --version --width --height --msaa --light-samples --ambient-samples --environment-lights --bounces --indirect-samples --angles --curvature --single-scattering --opposed --unscattered --seed --exposure --stops --white --bloom --bloom-radius --denoise --dof --tonemap --pixel-filter --exit --boundary --profile --specular" -- "$current")) ;;
        merge) COMPREPLY=($(compgen -W "--partial --input --checkpoint --allow-outside --output --format --engine --device --threads --json --progress --quiet --log-level --help --version" -- "$current")) ;;
        check) COMPREPLY=($(compgen -W "--material --size --unit --camera --time --animation --allow-outside --limit --up --normals --thicken --cross-section --line --down-to --layers-of --json --quiet --log-level --help --version" -- "$current")) ;;
        bake-layers) COMPREPLY=($(compgen -W "--inner --map-size --down-to --output --size --unit --limit --threads --json --quiet --log-level --help --version" -- "$current")) ;;
        methods) COMPREPLY=($(compgen -W "--json --quiet --log-level --help --version" -- "$current")) ;;
        materials) COMPREPLY=($(compgen -W "--json --quiet --log-level --help --version" -- "$current")) ;;
        profile) COMPREPLY=($(compgen -W "--limit --model --compare --gaussians --shared --free --eta --roughness --layers --skin --wavelength --solver --from --to --points --weighted --csv --export --taps --rank --output --json --quiet --log-level --help --version" -- "$current")) ;;
        bench) COMPREPLY=($(compgen -W "--allow-outside --limit --method --set --samples --time-limit --target-error --repeats --engine --device --threads --json --quiet --log-level --help --version --width --height --msaa --light-samples --ambient-samples --environment-lights --bounces --indirect-samples --angles --curvature --single-scattering --opposed --unscattered --seed --exposure --stops --white --bloom --bloom-radius --dof --tonemap --pixel-filter --exit --boundary --profile --specular" -- "$current")) ;;
        compare) COMPREPLY=($(compgen -W "--material --size --unit --camera --time --animation --allow-outside --limit --set --up --normals --thicken --from --studio --environment --environment-rotate --environment-scale --background --ground --scene-range --methods --reference --decompose --layer --mask --half --output --engine --device --threads --json --quiet --log-level --help --version --width --height --msaa --light-samples --ambient-samples --environment-lights --bounces --indirect-samples --angles --curvature --single-scattering --opposed --unscattered --seed --stops --bloom --bloom-radius --dof --pixel-filter --exit --boundary --profile --specular --ppd --exposure --white --tonemap --exposures --floor" -- "$current")) ;;
        view) COMPREPLY=($(compgen -W "--material --size --unit --camera --time --animation --allow-outside --limit --method --set --samples --time-limit --target-error --up --normals --thicken --from --studio --environment --environment-rotate --environment-scale --background --ground --port --listen --token-file --end-after --no-open --engine --device --threads --json --quiet --log-level --help --version --width --height --msaa --light-samples --ambient-samples --environment-lights --bounces --indirect-samples --angles --curvature --single-scattering --opposed --unscattered --seed --exposure --stops --white --bloom --bloom-radius --denoise --dof --tonemap --pixel-filter --exit --boundary --profile --specular" -- "$current")) ;;
        info) COMPREPLY=($(compgen -W "--engine --device --threads --json --quiet --log-level --help --version" -- "$current")) ;;
        esac
        return ;;
    esac
    case $command in
    methods) COMPREPLY=($(compgen -W "screen-space image-space texture-space convolution layered hierarchical dipole path-trace single-scatter" -- "$current")) ;;
    materials | profile) mapfile -t COMPREPLY < <(compgen -W "apple apple-juice apple-skin budweiser-beer cappuccino-powder chardonnay chicken1 chicken2 clorox coke coors-light-beer cranberry-juice cream espresso fish gatorade grape-juice head-and-shoulders-shampoo jade ketchup leaf lemon-tea-powder lowfat-chocolate-milk lowfat-milk lowfat-soy-milk marble marble-4gaussian merlot mint-mocha-coffee orange-juice orange-powder pacific-ocean-surface-water paint-coat pepsi pink-lemonade-powder potato reduced-milk regular-chocolate-milk regular-milk regular-soy-milk ruby-grapefruit-juice salt-powder shampoo skimmilk skin skin-2layer skin-3layer skin-4gaussian skin-6gaussian skin1 skin2 soap spectralon sprite strawberry-shampoo sugar-powder suisse-mocha-powder wax white-grapefruit-juice white-zinfandel wholemilk" -- "$current"; compgen -f -- "$current") ;;
    *) mapfile -t COMPREPLY < <(compgen -f -- "$current") ;;
    esac
}
complete -o filenames -F _pellucid pellucid
