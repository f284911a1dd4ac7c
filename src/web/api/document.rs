//! The OpenAPI document: made from the same list of paths as the router, so that neither can lack what the other has.

use std::sync::LazyLock;

use axum::{
    http::header,
    response::{IntoResponse, Response},
};
use utoipa::openapi::{
    Components, ContentBuilder, InfoBuilder, LicenseBuilder, OpenApi, OpenApiBuilder, Ref, RefOr,
    Required, Response as ResponseItem, ResponseBuilder, Schema,
    header::HeaderBuilder,
    path::{Operation, ParameterBuilder, ParameterIn, PathItem},
    schema::{AdditionalProperties, Object, ObjectBuilder, OneOfBuilder, Type},
    security::{HttpAuthScheme, HttpBuilder, SecurityScheme},
    tag::TagBuilder,
};
use utoipa_axum::router::OpenApiRouter;

use super::{NoQuery, documents, extract::Query, studies};
use crate::web::{ApiError, problem::Problem};

pub(super) static DOCUMENT: LazyLock<String> = LazyLock::new(document);

const TAGS: [(&str, &str); 6] = [
    ("studies", "What this server serves"),
    (
        "results",
        "Counts, fits, curves and comparisons: for tokens with the scope `results`",
    ),
    (
        "data",
        "Answers of people one by one: for tokens with the scope `data`",
    ),
    ("predict", "What a person will choose"),
    ("events", "What changed, as it happens"),
    ("description", "This API itself"),
];

/// What any path may be answered with beside what stands at it.
const REFUSALS: [(&str, &str, &str); 7] = [
    (
        "400",
        "BadRequest",
        "The path, the query or the body could not be read; `detail` says which and what is allowed",
    ),
    (
        "401",
        "Unauthorized",
        "A token is needed, or the one that was sent is not valid (any more)",
    ),
    (
        "403",
        "Forbidden",
        "The token lacks the scope; without accounts, this is not the server's own machine; or the results are still hidden, and then `blind` says until when",
    ),
    ("404", "NotFound", "Nothing has this address, id or name"),
    (
        "429",
        "TooManyRequests",
        "Too many requests in a short time",
    ),
    (
        "500",
        "Internal",
        "A fault of the server; its log tells more under `request_id`",
    ),
    (
        "503",
        "Busy",
        "The server is busy; nothing was lost, try again after `Retry-After` seconds",
    ),
];

/// Types that a client sends, or of which a part is left out where there is none.
const PARTLY_OPTIONAL: [&str; 4] = ["PredictionRequest", "Problem", "Sweep", "RiskAwareOptions"];

/// Properties whose named values may be null, which utoipa cannot derive.
const NULL_BY_NAME: [(&str, &str); 5] = [
    ("AccuracyCell", "models"),
    ("PooledRow", "models"),
    ("CheckRow", "models"),
    ("HeldOut", "scores"),
    ("HeldOutProblem", "predictions"),
];

/// The document as JSON, as it is served and committed.
pub fn document() -> String {
    let mut api = OpenApiBuilder::new()
        .info(
            InfoBuilder::new()
                .title("riskaware")
                .version(env!("CARGO_PKG_VERSION"))
                .description(Some(
                    "Studies of risky choice, the answers to them, and the models that are fitted to the answers while they come in. \
                     Names are `snake_case`, units stand in names, times are RFC 3339 in UTC or milliseconds since 1970 (`..._ms`). \
                     A number that does not exist is null. Every error is `application/problem+json` (RFC 9457).",
                ))
                .license(Some(LicenseBuilder::new().name("MIT").identifier(Some("MIT")).build())),
        )
        .tags(Some(TAGS.map(|(name, text)| {
            TagBuilder::new().name(name).description(Some(text)).build()
        })))
        .build();
    api.merge(
        OpenApiRouter::<crate::web::AppState>::new()
            .nest("/api/v1", studies().merge(documents()))
            .into_openapi(),
    );
    complete(&mut api);
    let text = api.to_pretty_json().unwrap_or_default();
    // Descriptions are doc comments; their links lead nowhere outside of the program's own documentation.
    text.replace("[`", "`").replace("`]", "`") + "\n"
}

/// Adds what no single path tells.
fn complete(api: &mut OpenApi) {
    let components = api.components.get_or_insert_with(Components::new);
    for (name, schema) in &mut components.schemas {
        if !PARTLY_OPTIONAL.contains(&name.as_str()) {
            require_all(schema);
        }
    }
    for (name, property) in NULL_BY_NAME {
        if let Some(RefOr::T(Schema::Object(object))) = components.schemas.get_mut(name)
            && let Some(RefOr::T(Schema::Object(named))) = object.properties.get_mut(property)
            && let Some(AdditionalProperties::RefOr(value)) =
                named.additional_properties.as_deref_mut()
        {
            let or_null = OneOfBuilder::new()
                .item(ObjectBuilder::new().schema_type(Type::Null))
                .item(value.clone());
            *value = RefOr::T(or_null.into());
        }
    }
    for (status, name, description) in REFUSALS {
        let mut response = problem(description);
        if ["429", "503"].contains(&status) {
            let seconds = HeaderBuilder::new()
                .schema(Some(ObjectBuilder::new().schema_type(Type::Integer)))
                .description(Some("After how many seconds to try again"));
            let name = "Retry-After".to_owned();
            response.headers.insert(name, seconds.build().into());
        }
        components
            .responses
            .insert(name.to_owned(), RefOr::T(response));
    }
    components.schemas.insert(
        "Problem".to_owned(),
        <Problem as utoipa::PartialSchema>::schema(),
    );
    let token = HttpBuilder::new()
        .scheme(HttpAuthScheme::Bearer)
        .description(Some(
            "A token with one or more of the scopes `results` (counts, fits, curves, predictions), `data` (answers and exports) and \
             `manage` (changes of a study). Where a path also stands without a scheme, a server without accounts answers it without a \
             token to programs on its own machine, or to everybody if it was started so.",
        ))
        .build();
    components
        .security_schemes
        .insert("token".to_owned(), RefOr::T(SecurityScheme::Http(token)));
    for (path, item) in &mut api.paths.paths {
        for (method, operation) in operations(item) {
            operation.operation_id = Some(operation_id(method, path));
            if operation.security.is_some() {
                for (status, name, _) in REFUSALS {
                    if status != "404" || path.contains('{') {
                        let refusal = Ref::from_response_name(name);
                        operation
                            .responses
                            .responses
                            .insert(status.to_owned(), RefOr::Ref(refusal));
                    }
                }
            }
            describe_tag(operation);
        }
    }
}

/// A name for each operation, made of its method and path, for programs that are generated from the document.
fn operation_id(method: &str, path: &str) -> String {
    let words = path
        .split(|letter: char| !letter.is_ascii_alphanumeric())
        .filter(|word| !["", "api", "v1"].contains(word));
    words.fold(method.to_owned(), |id, word| format!("{id}_{word}"))
}

/// Where 304 may be answered: the header that asks for it, and the one that holds what to send in it.
fn describe_tag(operation: &mut Operation) {
    let responses = &mut operation.responses.responses;
    let Some(RefOr::T(unchanged)) = responses.get_mut("304") else {
        return;
    };
    "What `If-None-Match` names is still current".clone_into(&mut unchanged.description);
    if let Some(RefOr::T(answer)) = responses.get_mut("200") {
        let tag = HeaderBuilder::new()
            .schema(Some(ObjectBuilder::new().schema_type(Type::String)))
            .description(Some("To be sent in `If-None-Match`"));
        answer.headers.insert("ETag".to_owned(), tag.build().into());
    }
    let known = ParameterBuilder::new()
        .name("If-None-Match")
        .parameter_in(ParameterIn::Header)
        .required(Required::False)
        .description(Some(
            "The `ETag` of an earlier answer; 304 if it is still current",
        ))
        .schema(Some(ObjectBuilder::new().schema_type(Type::String)));
    operation
        .parameters
        .get_or_insert_default()
        .push(known.build().into());
}

fn operations(item: &mut PathItem) -> impl Iterator<Item = (&'static str, &mut Operation)> {
    let PathItem {
        get,
        post,
        put,
        patch,
        delete,
        ..
    } = item;
    [
        ("get", get),
        ("post", post),
        ("put", put),
        ("patch", patch),
        ("delete", delete),
    ]
    .into_iter()
    .filter_map(|(method, operation)| Some((method, operation.as_mut()?)))
}

fn problem(description: &str) -> ResponseItem {
    ResponseBuilder::new()
        .description(description)
        .content(
            "application/problem+json",
            ContentBuilder::new()
                .schema(Some(Ref::from_schema_name("Problem")))
                .build(),
        )
        .build()
}

/// Answers always have all their properties: what does not exist is null, not missing.
fn require_all(schema: &mut RefOr<Schema>) {
    let RefOr::T(schema) = schema else { return };
    match schema {
        Schema::Object(object) => require_properties(object),
        Schema::AllOf(all) => all.items.iter_mut().for_each(require_all),
        Schema::OneOf(one) => one.items.iter_mut().for_each(require_all),
        Schema::AnyOf(any) => any.items.iter_mut().for_each(require_all),
        _ => {}
    }
}

fn require_properties(object: &mut Object) {
    object.required = object.properties.keys().cloned().collect();
    object.properties.values_mut().for_each(require_all);
}

/// This document.
#[utoipa::path(
    get, path = "/openapi.json", tag = "description",
    responses((status = 200, description = "The OpenAPI document", body = serde_json::Value)),
    security(()),
)]
pub(super) async fn openapi(Query(NoQuery {}): Query<NoQuery>) -> Result<Response, ApiError> {
    let headers = [(header::CONTENT_TYPE, "application/json")];
    Ok((headers, DOCUMENT.as_str()).into_response())
}
